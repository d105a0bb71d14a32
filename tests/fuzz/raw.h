/* raw.h - what the fuzz targets of lib/ share: bytes in, raw bits of any type out, and a check that
 * ends the run. */
#ifndef RAW_H
#define RAW_H

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "axt_axis.h"

/* What the fuzzer calls, once an execution. */
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

/* Bytes not yet used. */
typedef struct {
    const uint8_t *next;
    size_t left;
} raw_bytes;

/* The next bytes as they stand; false, and nothing written, when too few are left. */
static inline bool take(raw_bytes *from, void *to, size_t size) {
    if (from->left < size) {
        return false;
    }
    memcpy(to, from->next, size);
    from->next += size;
    from->left -= size;
    return true;
}

/* A byte, 0 when none is left. */
static inline uint8_t take_byte(raw_bytes *from) {
    uint8_t byte = 0;
    (void)take(from, &byte, 1);
    return byte;
}

/* A magnitude from low to high, of two bytes: raw bits would seldom be in range. */
static inline axt_real take_magnitude(raw_bytes *from, double low, double high) {
    uint16_t place = 0;
    (void)take(from, &place, sizeof place);
    return (axt_real)(low * pow(high / low, place / 65535.0));
}

#define expect(condition) expect_at((condition), __FILE__, __LINE__, #condition)

static inline void expect_at(bool holds, const char *file, int line, const char *text) {
    if (!holds) {
        (void)fprintf(stderr, "%s:%d: not true: %s\n", file, line, text);
        abort();
    }
}

static inline bool all_finite(const axt_real *values, size_t count) {
    bool finite = true;
    for (size_t i = 0; i < count; i++) {
        finite = finite && isfinite((double)values[i]);
    }
    return finite;
}

/* The paper's axis, one from anywhere in the ranges of axt_axis.h, or raw bits. */
static inline axt_axis take_axis(raw_bytes *from, uint8_t kind) {
    axt_axis axis = axt_axis_paper;
    if (kind % 4 == 1) {
        (void)take(from, &axis, sizeof axis);
    } else if (kind % 4 > 1) {
        axis.I1 = take_magnitude(from, 1e-9, 1e6);
        axis.I2 = take_magnitude(from, 1e-9, 1e6);
        axis.B = take_magnitude(from, 1e-9, 1e9);
        axis.K = take_magnitude(from, 1e-6, 1e12);
    }
    return axis;
}

#endif
