/* Instructions counted by callgrind (valgrind --tool=callgrind --collect-atstart=no): one part of
 * its output a count, named by the request that wrote it. */
#include "counter.h"

#include <stdio.h>
#include <stdlib.h>

#include <valgrind/callgrind.h>

void counter_init(void) {
    if (RUNNING_ON_VALGRIND == 0) {
        counter_fail("this program counts only under valgrind");
    }
}

void counter_section(const char *name) {
    char line[64];
    (void)snprintf(line, sizeof line, "section %s", name);
    CALLGRIND_DUMP_STATS_AT(line);
}

void counter_begin(void) {
    CALLGRIND_TOGGLE_COLLECT;
}

void counter_end(const char *name) {
    CALLGRIND_TOGGLE_COLLECT;
    CALLGRIND_DUMP_STATS_AT(name);
}

/* Seen in the emulated targets only. */
void counter_stack(const char *name, void (*run)(void)) {
    (void)name;
    run();
}

_Noreturn void counter_fail(const char *why) {
    (void)fprintf(stderr, "%s\n", why);
    exit(1);
}
