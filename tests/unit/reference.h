/* reference.h - what the unit tests of lib/ check against: the axis of Eq. 3 by the textbook and in
 * extended precision, and the little else that they share. Nothing here calls the library.
 */
#ifndef REFERENCE_H
#define REFERENCE_H

#include "axt_real.h"

#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

typedef long double wide;

#define PI 3.141592653589793238462643L

/* One of two numbers: for a library in float, for one in double. */
#define BY_TYPE(in_float, in_double)                                                               \
    ((sizeof(axt_real) == sizeof(float)) ? (in_float) : (in_double))
#define REAL_EPSILON BY_TYPE((double)FLT_EPSILON, DBL_EPSILON)

#define COUNT_OF(array) (sizeof(array) / sizeof((array)[0]))

/* Sanitizers make the code several times slower, so long runs are shortened under them. */
#if defined(__SANITIZE_ADDRESS__)
#define SHORTENED 10
#elif defined(__has_feature)
#if __has_feature(address_sanitizer)
#define SHORTENED 10
#endif
#endif
#ifndef SHORTENED
#define SHORTENED 1
#endif

static inline void say_if_shortened(const char *program) {
    if (SHORTENED != 1) {
        (void)printf("%s: sanitized, so long runs have 1/%d of their steps\n", program, SHORTENED);
    }
}

/* Is an object, byte by byte, what it was when `before` was copied from it? */
static inline bool same_bytes(const void *object, const void *before, size_t size) {
    return memcmp(object, before, size) == 0;
}
#define UNCHANGED(object, before) same_bytes(&(object), &(before), sizeof(object))

static const axt_real not_finite[] = {(axt_real)NAN, (axt_real)INFINITY, (axt_real)-INFINITY};

/* ---- Random numbers: SplitMix64 (Steele, Lea, Flood 2014) ------------------------------------ */

static inline uint64_t random_bits(uint64_t *seed) {
    *seed += UINT64_C(0x9E3779B97F4A7C15);
    uint64_t z = *seed;
    z = (z ^ (z >> 30)) * UINT64_C(0xBF58476D1CE4E5B9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94D049BB133111EB);
    return z ^ (z >> 31);
}

/* Evenly spread over low .. high. */
static inline axt_real uniform(uint64_t *seed, double low, double high) {
    const double unit = (double)(random_bits(seed) >> 11) * 0x1p-53;
    return (axt_real)(low + (high - low) * unit);
}

/* Evenly spread over the magnitudes low .. high. */
static inline axt_real log_uniform(uint64_t *seed, double low, double high) {
    return (axt_real)exp((double)uniform(seed, log(low), log(high)));
}

/* Variance 1: twelve uniform numbers, each of variance 1/12. */
static inline axt_real gaussian(uint64_t *seed) {
    axt_real sum = 0;
    for (int i = 0; i < 12; i++) {
        sum += uniform(seed, -0.5, 0.5);
    }
    return sum;
}

/* ---- The axis of Eq. 3 by Newmark's method as the paper writes it: absolute angles, Eqs. 4-6 --
 */

typedef struct {
    wide I[2], B, K;
    wide time_step, alpha, delta;
    wide angle[2], speed[2], acceleration[2]; /* motor, table */
} textbook_axis;

/* (I + damping_step [B] + stiffness_step [K]) acceleration = torque - [B] speed - [K] angle, where
 * [B] and [K] are B and K times [1 -1; -1 1]: a 2 x 2 system, by Cramer's rule. */
static inline void textbook_solve(textbook_axis *axis, wide motor_torque, wide table_torque,
                                  const wide speed[2], const wide angle[2], wide damping_step,
                                  wide stiffness_step) {
    const wide shaft = axis->B * (speed[0] - speed[1]) + axis->K * (angle[0] - angle[1]);
    const wide coupling = damping_step * axis->B + stiffness_step * axis->K;
    const wide motor = axis->I[0] + coupling;
    const wide table = axis->I[1] + coupling;
    const wide right[2] = {motor_torque - shaft, table_torque + shaft};
    const wide per_determinant = 1 / (motor * table - coupling * coupling);
    axis->acceleration[0] = (right[0] * table + right[1] * coupling) * per_determinant;
    axis->acceleration[1] = (right[1] * motor + right[0] * coupling) * per_determinant;
}

/* Eq. 3 itself: the acceleration where the axis is. */
static inline void textbook_start(textbook_axis *axis, wide motor_torque, wide table_torque) {
    textbook_solve(axis, motor_torque, table_torque, axis->speed, axis->angle, 0, 0);
}

static inline void textbook_step(textbook_axis *axis, wide motor_torque, wide table_torque) {
    const wide h = axis->time_step;
    wide angle[2];
    wide speed[2];
    for (int i = 0; i < 2; i++) {
        angle[i] = axis->angle[i] + h * axis->speed[i] +
                   (0.5L - axis->alpha) * h * h * axis->acceleration[i];
        speed[i] = axis->speed[i] + (1 - axis->delta) * h * axis->acceleration[i];
    }
    textbook_solve(axis, motor_torque, table_torque, speed, angle, axis->delta * h,
                   axis->alpha * h * h);
    for (int i = 0; i < 2; i++) {
        axis->angle[i] = angle[i] + axis->alpha * h * h * axis->acceleration[i];
        axis->speed[i] = speed[i] + axis->delta * h * axis->acceleration[i];
    }
}

/* ---- The same axis under torque that is held from sample to sample: the matrix exponential ----
 */

/* exp(A h) - 1 of A = [0 1; -k -d]: its Taylor series for 2^-20 of the step, squared 20 times. The
 * 1 is kept apart, as it would swallow the digits of a short step. */
static inline void exponential_less_one(wide d, wide k, wide h, wide E[2][2]) {
    const wide A[2][2] = {{0, 1}, {-k, -d}};
    enum { TERMS = 12, SQUARINGS = 20 };
    const wide part = ldexpl(h, -SQUARINGS);
    wide term[2][2] = {{1, 0}, {0, 1}};
    memset(E, 0, 4 * sizeof E[0][0]);
    for (int n = 1; n <= TERMS; n++) {
        wide next[2][2];
        for (int i = 0; i < 4; i++) {
            next[i / 2][i % 2] =
                part / n * (term[i / 2][0] * A[0][i % 2] + term[i / 2][1] * A[1][i % 2]);
        }
        memcpy(term, next, sizeof term);
        for (int i = 0; i < 4; i++) {
            E[i / 2][i % 2] += term[i / 2][i % 2];
        }
    }
    for (int n = 0; n < SQUARINGS; n++) { /* (1 + E)^2 - 1 = 2 E + E E */
        wide next[2][2];
        for (int i = 0; i < 4; i++) {
            next[i / 2][i % 2] =
                2 * E[i / 2][i % 2] + E[i / 2][0] * E[0][i % 2] + E[i / 2][1] * E[1][i % 2];
        }
        memcpy(E, next, sizeof next);
    }
}

/* x'' + damping x' + stiffness x = f over a time step: what [x, x'] changes by. */
typedef struct {
    wide of_state[2][2];
    wide of_force[2];
} held_map;

static inline held_map held_map_of(wide damping, wide stiffness, wide time_step) {
    held_map map;
    exponential_less_one(damping, stiffness, time_step, map.of_state);
    /* A^-1 (exp(A h) - 1) [0, f] */
    map.of_force[0] = -(damping * map.of_state[0][1] + map.of_state[1][1]) / stiffness;
    map.of_force[1] = map.of_state[0][1];
    return map;
}

/* A step of an axis under motor torque that is held over it; its acceleration is not kept. */
static inline void held_step(textbook_axis *axis, const held_map *twist_map, wide torque) {
    const wide h = axis->time_step;
    const wide inertia = axis->I[0] + axis->I[1];
    const wide share = axis->I[1] / inertia;
    const wide twist[2] = {axis->angle[0] - axis->angle[1], axis->speed[0] - axis->speed[1]};
    wide next[2];
    for (int i = 0; i < 2; i++) {
        next[i] = twist[i] + twist_map->of_state[i][0] * twist[0] +
                  twist_map->of_state[i][1] * twist[1] +
                  twist_map->of_force[i] * torque / axis->I[0];
    }
    const wide body_speed = axis->speed[0] - share * twist[1];
    const wide body_change = h * torque / inertia;
    const wide body = axis->angle[0] - share * twist[0] + h * (body_speed + body_change / 2);
    axis->angle[0] = body + share * next[0];
    axis->angle[1] = axis->angle[0] - next[0];
    axis->speed[0] = body_speed + body_change + share * next[1];
    axis->speed[1] = axis->speed[0] - next[1];
}

#endif
