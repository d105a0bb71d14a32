/* memcpy() word by word: those of small C libraries go byte by byte, and the control interrupt
 * copies the estimator now and then. */
#include <stddef.h>
#include <stdint.h>
#include <string.h>

/* May be anything's bytes. */
typedef uint32_t __attribute__((may_alias)) word;

void *memcpy(void *restrict to, const void *restrict from, size_t size) {
    uint8_t *byte = to;
    const uint8_t *source = from;
    if ((((uintptr_t)to | (uintptr_t)from) % sizeof(word)) == 0) {
        for (; size >= sizeof(word); size -= sizeof(word)) {
            *(word *)(void *)byte = *(const word *)(const void *)source;
            byte += sizeof(word);
            source += sizeof(word);
        }
    }
    for (; size > 0; size--) {
        *byte++ = *source++;
    }
    return to;
}
