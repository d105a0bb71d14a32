/* Excitation signals, against their spectra (a direct DFT), closed forms and defining properties.
 */
#include "axt_excitation.h"

#include "check.h"
#include "reference.h"

#include <stdlib.h>

enum { LENGTH_MAX = 1048576 };

/* The signals of the paper's two settings: 2 k lines from the first harmonic on. */
static const axt_schroeder paper_a = {
    .length = 512, .first = 1, .stride = 1, .lines = 20, .rms = (axt_real)0.2};
static const axt_schroeder paper_b = {
    .length = 2048, .first = 1, .stride = 1, .lines = 292, .rms = (axt_real)0.2};

static axt_real table[LENGTH_MAX];
static axt_real other[LENGTH_MAX];

/* cos(2 pi i / N), i = 0 .. N - 1: the argument of a DFT never needs more. */
static double cosine[LENGTH_MAX];

static void set_cosine(uint32_t length) {
    for (uint32_t i = 0; i < length; i++) {
        cosine[i] = (double)cosl(2 * PI * i / length);
    }
}

/* One line of the discrete Fourier transform by its sum, as amplitude x cos(2 pi h n / N + phase).
 */
typedef struct {
    double in_phase;   /* amplitude x cos(phase) */
    double quadrature; /* amplitude x sin(phase) */
} line;

static line transform(const axt_real *samples, uint32_t length, uint32_t harmonic) {
    const double weight = (harmonic == 0 || 2 * harmonic == length) ? 1 : 2;
    line sum = {0, 0};
    uint32_t angle = 0;
    for (uint32_t n = 0; n < length; n++) {
        sum.in_phase += (double)samples[n] * cosine[angle];
        /* sin(x) = cos(x + 3/4 turn) */
        sum.quadrature -= (double)samples[n] * cosine[(angle + 3 * (length / 4)) % length];
        angle = (angle + harmonic) % length;
    }
    sum.in_phase *= weight / length;
    sum.quadrature *= weight / length;
    return sum;
}

static double rms_of(const axt_real *samples, uint32_t length) {
    wide sum = 0;
    for (uint32_t n = 0; n < length; n++) {
        sum += (wide)samples[n] * (wide)samples[n];
    }
    return (double)sqrtl(sum / length);
}

static double crest_factor(const axt_real *samples, uint32_t length) {
    double peak = 0;
    for (uint32_t n = 0; n < length; n++) {
        peak = fmax(peak, fabs((double)samples[n]));
    }
    return peak / rms_of(samples, length);
}

/* Rounding of a sum of `lines` cosines of this amplitude, each right to 4 units in the last place.
 */
static double rounding(double amplitude, uint32_t lines) {
    return 4 * REAL_EPSILON * amplitude * lines;
}

static void check_flat_spectrum(const axt_schroeder *signal) {
    const double amplitude = (double)signal->rms * sqrt(2.0 / signal->lines);
    const double tolerance = rounding(amplitude, signal->lines);
    const uint32_t last = signal->first + signal->stride * (signal->lines - 1);
    set_cosine(signal->length);
    for (uint32_t harmonic = 0; harmonic <= signal->length / 2; harmonic++) {
        const line found = transform(table, signal->length, harmonic);
        const bool chosen = harmonic >= signal->first && harmonic <= last &&
                            (harmonic - signal->first) % signal->stride == 0;
        CHECK_NEAR(hypot(found.in_phase, found.quadrature), chosen ? amplitude : 0, tolerance);
    }
}

CASE(the_spectrum_is_flat_at_the_chosen_lines_and_zero_elsewhere) {
    axt_schroeder odd_lines = paper_a;
    odd_lines.first = 3;
    odd_lines.stride = 2;
    odd_lines.lines = 120;
    axt_schroeder up_to_the_last = paper_a;
    up_to_the_last.lines = 255;
    axt_schroeder random = paper_b;
    random.seed = 7;
    const axt_schroeder signals[] = {paper_a, paper_b, odd_lines, up_to_the_last, random};
    for (size_t i = 0; i < COUNT_OF(signals); i++) {
        CHECK_EQUAL(axt_schroeder_fill(&signals[i], table, LENGTH_MAX), AXT_OK);
        check_flat_spectrum(&signals[i]);
    }
}

/* Schroeder's general rule for relative line powers p: phase[n] = phase[1] - 2 pi sum over l < n of
 * (n - l) p[l]; all p are 1 / L here. */
CASE(the_phases_are_schroeder_s) {
    const axt_schroeder *const signals[] = {&paper_a, &paper_b};
    for (size_t i = 0; i < COUNT_OF(signals); i++) {
        const axt_schroeder *signal = signals[i];
        const double amplitude = (double)signal->rms * sqrt(2.0 / signal->lines);
        CHECK_EQUAL(axt_schroeder_fill(signal, table, LENGTH_MAX), AXT_OK);
        set_cosine(signal->length);
        wide phase = 0;
        wide slope = 0; /* the sum of p[l] up to here */
        for (uint32_t n = 1; n <= signal->lines; n++) {
            const line found = transform(table, signal->length, n);
            CHECK_NEAR(found.in_phase, amplitude * (double)cosl(phase),
                       rounding(amplitude, signal->lines));
            CHECK_NEAR(found.quadrature, amplitude * (double)sinl(phase),
                       rounding(amplitude, signal->lines));
            slope += 1 / (wide)signal->lines;
            phase -= 2 * PI * slope;
        }
    }
}

CASE(the_rms_is_the_one_asked_for) {
    static const double rms[] = {0.2, 1, 1e-6, 3000};
    for (size_t i = 0; i < COUNT_OF(rms); i++) {
        axt_schroeder signal = paper_b;
        signal.rms = (axt_real)rms[i];
        CHECK_EQUAL(axt_schroeder_fill(&signal, table, LENGTH_MAX), AXT_OK);
        CHECK_NEAR(rms_of(table, signal.length) / rms[i], 1, 4 * REAL_EPSILON);
    }
}

CASE(schroeder_s_phases_keep_the_crest_factor_low) {
    CHECK_EQUAL(axt_schroeder_fill(&paper_a, table, LENGTH_MAX), AXT_OK);
    CHECK(crest_factor(table, paper_a.length) < 1.9);
    CHECK_EQUAL(axt_schroeder_fill(&paper_b, table, LENGTH_MAX), AXT_OK);
    const double schroeder = crest_factor(table, paper_b.length);
    CHECK(schroeder < 1.9);
    for (uint32_t seed = 1; seed <= 20; seed++) {
        axt_schroeder random = paper_b;
        random.seed = seed;
        CHECK_EQUAL(axt_schroeder_fill(&random, table, LENGTH_MAX), AXT_OK);
        CHECK(crest_factor(table, random.length) > 1.3 * schroeder);
    }
}

static double correlation(const axt_real *a, const axt_real *b, uint32_t length) {
    wide sum = 0;
    for (uint32_t n = 0; n < length; n++) {
        sum += (wide)a[n] * (wide)b[n];
    }
    return (double)sum / length / (rms_of(a, length) * rms_of(b, length));
}

CASE(another_seed_is_another_signal_and_the_same_seed_the_same) {
    enum { SEEDS = 20, LENGTH = 2048 };
    static axt_real seeded[SEEDS][LENGTH];
    for (uint32_t seed = 0; seed < SEEDS; seed++) {
        axt_schroeder signal = paper_b;
        signal.seed = seed;
        CHECK_EQUAL(axt_schroeder_fill(&signal, seeded[seed], LENGTH), AXT_OK);
        CHECK_EQUAL(axt_schroeder_fill(&signal, other, LENGTH), AXT_OK);
        CHECK(same_bytes(seeded[seed], other, sizeof seeded[seed]));
        for (uint32_t earlier = 0; earlier < seed; earlier++) {
            /* of 292 independent phases: mean 0, standard deviation 1 / sqrt(2 x 292) = 0.04 */
            CHECK_NEAR(correlation(seeded[seed], seeded[earlier], LENGTH), 0, 0.2);
        }
    }
}

CASE(a_table_filled_line_by_line_is_the_same) {
    CHECK_EQUAL(axt_schroeder_fill(&paper_b, table, LENGTH_MAX), AXT_OK);
    memset(other, 0, sizeof other);
    for (uint32_t index = 0; index < paper_b.lines; index++) {
        CHECK_EQUAL(axt_schroeder_add_line(&paper_b, index, other), AXT_OK);
    }
    CHECK(same_bytes(table, other, paper_b.length * sizeof table[0]));
}

CASE(a_line_of_the_longest_period_is_as_exact_as_any) {
    const axt_schroeder signal = {
        .length = LENGTH_MAX, .first = 524287, .stride = 1, .lines = 1, .rms = 1};
    CHECK_EQUAL(axt_schroeder_fill(&signal, table, LENGTH_MAX), AXT_OK);
    for (uint64_t n = 0; n < LENGTH_MAX; n++) {
        const wide turns = (wide)(524287 * n % LENGTH_MAX) / LENGTH_MAX;
        CHECK_NEAR((wide)table[n] - sqrtl(2) * cosl(2 * PI * turns), 0, 8 * REAL_EPSILON);
    }
}

CASE(the_shortest_period_has_one_line) {
    const axt_schroeder signal = {.length = 4, .first = 1, .stride = 1, .lines = 1, .rms = 1};
    static const double expected[] = {1, 0, -1, 0};
    CHECK_EQUAL(axt_schroeder_fill(&signal, table, 4), AXT_OK);
    for (int n = 0; n < 4; n++) {
        CHECK_NEAR((double)table[n], sqrt(2) * expected[n], 4 * REAL_EPSILON);
    }
}

CASE(settings_that_make_no_sense_are_refused_and_nothing_is_written) {
    const struct {
        axt_schroeder signal;
        axt_status expected;
    } bad[] = {
        {{0, 1, 1, 1, 0, 1}, AXT_ERROR_RANGE},
        {{3, 1, 1, 1, 0, 1}, AXT_ERROR_RANGE},
        {{LENGTH_MAX + 1, 1, 1, 1, 0, 1}, AXT_ERROR_RANGE},
        {{UINT32_MAX, 1, 1, 1, 0, 1}, AXT_ERROR_RANGE},
        {{512, 0, 1, 1, 0, 1}, AXT_ERROR_RANGE},
        {{512, 1, 0, 1, 0, 1}, AXT_ERROR_RANGE},
        {{512, 1, 1, 0, 0, 1}, AXT_ERROR_RANGE},
        {{512, 256, 1, 1, 0, 1}, AXT_ERROR_RANGE}, /* the Nyquist frequency */
        {{511, 256, 1, 1, 0, 1}, AXT_ERROR_RANGE},
        {{512, 1, 1, 256, 0, 1}, AXT_ERROR_RANGE},
        {{512, 1, 5, 52, 0, 1}, AXT_ERROR_RANGE},
        {{512, UINT32_MAX, UINT32_MAX, UINT32_MAX, 0, 1}, AXT_ERROR_RANGE},
        /* a last harmonic of 2^63, whose double is 0 in 64 bits */
        {{512, UINT32_C(1) << 31, UINT32_MAX, (UINT32_C(1) << 31) + 1, 0, 1}, AXT_ERROR_RANGE},
        {{512, 1, 1, 1, 0, -1}, AXT_ERROR_RANGE},
        {{512, 1, 1, 1, 0, not_finite[0]}, AXT_ERROR_NOT_FINITE},
        {{512, 1, 1, 1, 0, not_finite[1]}, AXT_ERROR_NOT_FINITE},
        {{512, 1, 1, 1, 0, not_finite[2]}, AXT_ERROR_NOT_FINITE},
    };
    memset(table, 0x55, sizeof table);
    memset(other, 0x55, sizeof other);
    for (size_t i = 0; i < COUNT_OF(bad); i++) {
        CHECK_EQUAL(axt_schroeder_check(&bad[i].signal), bad[i].expected);
        if (axt_schroeder_check(&bad[i].signal) != AXT_OK) { /* or these may never return */
            CHECK_EQUAL(axt_schroeder_fill(&bad[i].signal, table, LENGTH_MAX), bad[i].expected);
            CHECK_EQUAL(axt_schroeder_add_line(&bad[i].signal, 0, table), bad[i].expected);
        }
    }
    CHECK_EQUAL(axt_schroeder_add_line(&paper_a, paper_a.lines, table), AXT_ERROR_RANGE);
    CHECK_EQUAL(axt_schroeder_add_line(&paper_a, UINT32_MAX, table), AXT_ERROR_RANGE);
    CHECK_EQUAL(axt_schroeder_fill(&paper_a, table, paper_a.length - 1), AXT_ERROR_SIZE);
    CHECK_EQUAL(axt_schroeder_fill(&paper_a, table, 0), AXT_ERROR_SIZE);
    CHECK(same_bytes(table, other, sizeof table));
}

CASE(no_line_beyond_the_period_is_written) {
    memset(table, 0x55, sizeof table);
    memset(other, 0x55, sizeof other);
    CHECK_EQUAL(axt_schroeder_fill(&paper_a, table, LENGTH_MAX), AXT_OK);
    CHECK(same_bytes(table + paper_a.length, other + paper_a.length,
                     sizeof table - paper_a.length * sizeof table[0]));
}

CASE(a_player_repeats_its_table_for_ever) {
    CHECK_EQUAL(axt_schroeder_fill(&paper_a, table, LENGTH_MAX), AXT_OK);
    axt_player player;
    CHECK_EQUAL(axt_player_init(&player, table, paper_a.length), AXT_OK);
    for (uint32_t n = 0; n < 1000000 + paper_a.length; n++) {
        const axt_real sample = axt_player_step(&player);
        CHECK(same_bytes(&sample, &table[n % paper_a.length], sizeof sample));
    }
}

CASE(a_player_needs_a_table) {
    axt_player player = {.table = table, .length = 5, .next = 3};
    const axt_player before = player;
    CHECK_EQUAL(axt_player_init(&player, table, 0), AXT_ERROR_SIZE);
    CHECK(UNCHANGED(player, before));
}

/* ---- The other signals ---------------------------------------------------------------------- */

CASE(a_harmonic_is_one_cosine) {
    static const uint32_t harmonics[] = {1, 10, 241};
    static const uint32_t lengths[] = {512, 500, 483};
    for (size_t i = 0; i < COUNT_OF(harmonics) * COUNT_OF(lengths); i++) {
        const uint32_t harmonic = harmonics[i % COUNT_OF(harmonics)];
        const uint32_t length = lengths[i / COUNT_OF(harmonics)];
        CHECK_EQUAL(axt_harmonic_fill(table, length, harmonic), AXT_OK);
        for (uint32_t n = 0; n < length; n++) {
            CHECK_NEAR((wide)table[n] - cosl(2 * PI * (harmonic * n % length) / length), 0,
                       8 * REAL_EPSILON);
        }
    }
}

CASE(an_impulse_is_one_sample) {
    CHECK_EQUAL(axt_impulse_fill(table, 512), AXT_OK);
    for (uint32_t n = 0; n < 512; n++) {
        CHECK_NEAR(table[n], (n == 0) ? 1 : 0, 0);
    }
}

CASE(noise_is_gaussian_and_white) {
    enum { LENGTH = 262144 };
    CHECK_EQUAL(axt_noise_fill(table, LENGTH, 1), AXT_OK);
    double moment[5] = {0};
    double lagged[4] = {0};
    for (uint32_t n = 0; n < LENGTH; n++) {
        const double x = (double)table[n];
        CHECK(fabs(x) <= 6);
        double power = 1;
        for (size_t m = 0; m < COUNT_OF(moment); m++) {
            moment[m] += power / LENGTH;
            power *= x;
        }
        for (uint32_t lag = 1; lag < COUNT_OF(lagged); lag++) {
            lagged[lag] += x * (double)table[(n + lag) % LENGTH] / LENGTH;
        }
    }
    /* the kurtosis of a sum of 12 uniform numbers is 3 - 1.2 / 12; tolerances are 5 sigma */
    const double sigma = 1 / sqrt((double)LENGTH);
    CHECK_NEAR(moment[1], 0, 5 * sigma);
    CHECK_NEAR(moment[2], 1, 5 * sqrt(1.9) * sigma);
    CHECK_NEAR(moment[3], 0, 5 * sqrt(13.0) * sigma);
    CHECK_NEAR(moment[4], 2.9, 5 * sqrt(80.0) * sigma);
    for (uint32_t lag = 1; lag < COUNT_OF(lagged); lag++) {
        CHECK_NEAR(lagged[lag], 0, 5 * sigma);
    }
    CHECK_EQUAL(axt_noise_fill(other, LENGTH, 2), AXT_OK);
    CHECK_NEAR(correlation(table, other, LENGTH), 0, 5 * sigma);
}

/* A sequence is of maximum length when every pattern of n bits but all zeros occurs in it, once. */
CASE(binary_sequences_have_maximum_length_for_every_number_of_stages) {
    bool *seen = calloc(LENGTH_MAX, sizeof *seen);
    CHECK(seen != NULL);
    for (uint32_t stages = 3; seen != NULL && stages <= 20; stages++) {
        const uint32_t bits = (UINT32_C(1) << stages) - 1;
        CHECK_EQUAL(axt_binary_fill(table, bits, stages, 1), AXT_OK);
        memset(seen, 0, LENGTH_MAX * sizeof *seen);
        uint32_t pattern = 0;
        for (uint32_t n = 0; n < bits + stages - 1; n++) {
            const axt_real sample = table[n % bits];
            CHECK_NEAR(fabs((double)sample), 1, 0);
            pattern = ((pattern << 1) & bits) | ((sample > 0) ? 1U : 0U);
            if (n + 1 >= stages) {
                CHECK(pattern != 0 && !seen[pattern]);
                seen[pattern] = true;
            }
        }
    }
    free(seen);
}

CASE(binary_sequences_have_a_flat_spectrum) {
    const uint32_t bits = 1023;
    CHECK_EQUAL(axt_binary_fill(table, bits, 10, 1), AXT_OK);
    for (uint32_t shift = 0; shift < bits; shift++) {
        double sum = 0;
        for (uint32_t n = 0; n < bits; n++) {
            sum += (double)table[n] * (double)table[(n + shift) % bits];
        }
        CHECK_NEAR(sum, (shift == 0) ? 1023 : -1, 0);
    }
}

CASE(binary_sequences_can_hold_their_bits) {
    CHECK_EQUAL(axt_binary_fill(table, 127, 7, 1), AXT_OK);
    CHECK_EQUAL(axt_binary_fill(other, 635, 7, 5), AXT_OK);
    for (uint32_t n = 0; n < 635; n++) {
        CHECK(same_bytes(&other[n], &table[n / 5], sizeof other[n]));
    }
}

/* At s = n / N of the period the frequency is first + (last - first) s harmonics; the phase is its
 * integral, first s + (last - first) s^2 / 2 turns. An odd last - first is made even. */
CASE(a_chirp_sweeps_its_frequency_and_joins_itself) {
    static const struct {
        uint32_t length;
        uint32_t first;
        uint32_t last;
    } sweeps[] = {{512, 1, 21}, {2048, 10, 310}, {LENGTH_MAX, 1, 524287}, {1001, 5, 100}};
    for (size_t i = 0; i < COUNT_OF(sweeps); i++) {
        const uint32_t length = sweeps[i].length;
        const uint32_t span = sweeps[i].last - sweeps[i].first;
        const wide sweep = span + span % 2;
        CHECK_EQUAL(axt_chirp_fill(table, length, sweeps[i].first, sweeps[i].last), AXT_OK);
        for (uint32_t n = 0; n < length; n++) {
            const wide s = (wide)n / length;
            const wide turns = fmodl(s * sweeps[i].first + s * s * sweep / 2, 1);
            CHECK_NEAR((wide)table[n] - cosl(2 * PI * turns), 0, 8 * REAL_EPSILON);
        }
        const double steepest = 2 * (double)PI * (sweeps[i].last + 1) / length;
        CHECK_NEAR(table[0] - table[length - 1], 0, steepest);
    }
}

CASE(no_signal_is_longer_than_its_period) {
    table[127] = 100;
    CHECK_EQUAL(axt_harmonic_fill(table, 127, 5), AXT_OK);
    CHECK_EQUAL(axt_impulse_fill(table, 127), AXT_OK);
    CHECK_EQUAL(axt_noise_fill(table, 127, 1), AXT_OK);
    CHECK_EQUAL(axt_binary_fill(table, 127, 7, 1), AXT_OK);
    CHECK_EQUAL(axt_chirp_fill(table, 127, 1, 50), AXT_OK);
    CHECK_NEAR(table[127], 100, 0);
}

CASE(other_signals_refuse_what_makes_no_sense_and_write_nothing) {
    memset(table, 0x55, sizeof table);
    memset(other, 0x55, sizeof other);
    CHECK_EQUAL(axt_harmonic_fill(table, 0, 1), AXT_ERROR_SIZE);
    CHECK_EQUAL(axt_harmonic_fill(table, 512, 0), AXT_ERROR_RANGE);
    CHECK_EQUAL(axt_harmonic_fill(table, 512, 256), AXT_ERROR_RANGE);
    CHECK_EQUAL(axt_harmonic_fill(table, 512, UINT32_MAX), AXT_ERROR_RANGE);
    CHECK_EQUAL(axt_harmonic_fill(table, LENGTH_MAX + 1, 1), AXT_ERROR_RANGE);
    CHECK_EQUAL(axt_impulse_fill(table, 0), AXT_ERROR_SIZE);
    CHECK_EQUAL(axt_noise_fill(table, 0, 1), AXT_ERROR_SIZE);
    CHECK_EQUAL(axt_binary_fill(table, 3, 2, 1), AXT_ERROR_RANGE);
    CHECK_EQUAL(axt_binary_fill(table, UINT32_C(0x1FFFFF), 21, 1), AXT_ERROR_RANGE);
    CHECK_EQUAL(axt_binary_fill(table, 127, UINT32_MAX, 1), AXT_ERROR_RANGE);
    CHECK_EQUAL(axt_binary_fill(table, 127, 7, 0), AXT_ERROR_RANGE);
    CHECK_EQUAL(axt_binary_fill(table, 128, 7, 1), AXT_ERROR_SIZE);
    CHECK_EQUAL(axt_binary_fill(table, 127, 7, 2), AXT_ERROR_SIZE);
    /* 127 x hold is this length in 32 bits, but not in truth */
    CHECK_EQUAL(axt_binary_fill(table, UINT32_MAX - 126, 7, UINT32_MAX), AXT_ERROR_SIZE);
    CHECK_EQUAL(axt_chirp_fill(table, 0, 1, 10), AXT_ERROR_SIZE);
    CHECK_EQUAL(axt_chirp_fill(table, 512, 0, 10), AXT_ERROR_RANGE);
    CHECK_EQUAL(axt_chirp_fill(table, 512, 10, 10), AXT_ERROR_RANGE);
    CHECK_EQUAL(axt_chirp_fill(table, 512, 10, 9), AXT_ERROR_RANGE);
    CHECK_EQUAL(axt_chirp_fill(table, 512, 10, 256), AXT_ERROR_RANGE);
    CHECK_EQUAL(axt_chirp_fill(table, 512, 10, UINT32_MAX), AXT_ERROR_RANGE);
    CHECK_EQUAL(axt_chirp_fill(table, LENGTH_MAX + 1, 1, 10), AXT_ERROR_RANGE);
    CHECK(same_bytes(table, other, sizeof table));
}

/* ---- Scaling -------------------------------------------------------------------------------- */

CASE(a_table_can_be_scaled_to_an_rms) {
    CHECK_EQUAL(axt_noise_fill(table, 2048, 1), AXT_OK);
    table[2048] = 100; /* not part of it */
    CHECK_EQUAL(axt_table_scale_to_rms(table, 2048, (axt_real)0.2), AXT_OK);
    CHECK_NEAR(rms_of(table, 2048), 0.2, 0.2 * 8 * REAL_EPSILON);
    CHECK_NEAR(table[2048], 100, 0);
}

CASE(a_long_table_is_scaled_as_exactly_as_a_short_one) {
    const uint32_t length = LENGTH_MAX - 1;
    CHECK_EQUAL(axt_binary_fill(table, length, 20, 1), AXT_OK);
    CHECK_EQUAL(axt_table_scale_to_peak(table, length, (axt_real)0.1), AXT_OK);
    CHECK_EQUAL(axt_table_scale_to_rms(table, length, (axt_real)0.2), AXT_OK);
    CHECK_NEAR(rms_of(table, length), 0.2, BY_TYPE(2e-7, 2e-14));
}

CASE(a_table_can_be_scaled_to_a_peak) {
    CHECK_EQUAL(axt_noise_fill(table, 2048, 1), AXT_OK);
    table[2048] = 100; /* not part of it */
    memcpy(other, table, 2048 * sizeof table[0]);
    CHECK_EQUAL(axt_table_scale_to_peak(table, 2048, (axt_real)0.5), AXT_OK);
    CHECK_NEAR(crest_factor(table, 2048) * rms_of(table, 2048), 0.5, 0.5 * 2 * REAL_EPSILON);
    CHECK_NEAR(crest_factor(table, 2048) / crest_factor(other, 2048), 1, 8 * REAL_EPSILON);
    CHECK_NEAR(table[2048], 100, 0);
}

CASE(silence_is_a_signal_too) {
    axt_schroeder silent = paper_a;
    silent.rms = 0;
    CHECK_EQUAL(axt_schroeder_fill(&silent, table, LENGTH_MAX), AXT_OK);
    CHECK_NEAR(rms_of(table, silent.length), 0, 0);
    CHECK_EQUAL(axt_noise_fill(table, 512, 1), AXT_OK);
    CHECK_EQUAL(axt_table_scale_to_rms(table, 512, 0), AXT_OK);
    CHECK_NEAR(rms_of(table, 512), 0, 0);
    CHECK_EQUAL(axt_noise_fill(table, 512, 1), AXT_OK);
    CHECK_EQUAL(axt_table_scale_to_peak(table, 512, 0), AXT_OK);
    CHECK_NEAR(rms_of(table, 512), 0, 0);
}

CASE(what_cannot_be_scaled_is_left_alone) {
    CHECK_EQUAL(axt_noise_fill(table, 512, 1), AXT_OK);
    memcpy(other, table, 512 * sizeof table[0]);
    CHECK_EQUAL(axt_table_scale_to_rms(table, 512, -1), AXT_ERROR_RANGE);
    CHECK_EQUAL(axt_table_scale_to_peak(table, 512, -1), AXT_ERROR_RANGE);
    for (size_t i = 0; i < COUNT_OF(not_finite); i++) {
        CHECK_EQUAL(axt_table_scale_to_rms(table, 512, not_finite[i]), AXT_ERROR_RANGE);
        CHECK_EQUAL(axt_table_scale_to_peak(table, 512, not_finite[i]), AXT_ERROR_RANGE);
    }
    CHECK_EQUAL(axt_table_scale_to_rms(table, 0, 1), AXT_ERROR_NO_DATA);
    CHECK_EQUAL(axt_table_scale_to_peak(table, 0, 1), AXT_ERROR_NO_DATA);
    CHECK(same_bytes(table, other, 512 * sizeof table[0]));

    memset(table, 0, 512 * sizeof table[0]);
    memset(other, 0, 512 * sizeof table[0]);
    CHECK_EQUAL(axt_table_scale_to_rms(table, 512, 1), AXT_ERROR_NO_DATA);
    CHECK_EQUAL(axt_table_scale_to_peak(table, 512, 1), AXT_ERROR_NO_DATA);
    CHECK(same_bytes(table, other, 512 * sizeof table[0]));
}

CASE(a_table_whose_size_is_no_number_cannot_be_scaled) {
    const axt_real infinite[] = {1, (axt_real)INFINITY, 2};
    memcpy(table, infinite, sizeof infinite);
    CHECK_EQUAL(axt_table_scale_to_rms(table, 3, 1), AXT_ERROR_NO_DATA);
    CHECK_EQUAL(axt_table_scale_to_peak(table, 3, 1), AXT_ERROR_NO_DATA);
    CHECK(same_bytes(table, infinite, sizeof infinite));
}

int main(void) {
    RUN(a_table_whose_size_is_no_number_cannot_be_scaled);
    RUN(the_spectrum_is_flat_at_the_chosen_lines_and_zero_elsewhere);
    RUN(the_phases_are_schroeder_s);
    RUN(the_rms_is_the_one_asked_for);
    RUN(schroeder_s_phases_keep_the_crest_factor_low);
    RUN(another_seed_is_another_signal_and_the_same_seed_the_same);
    RUN(a_table_filled_line_by_line_is_the_same);
    RUN(a_line_of_the_longest_period_is_as_exact_as_any);
    RUN(the_shortest_period_has_one_line);
    RUN(settings_that_make_no_sense_are_refused_and_nothing_is_written);
    RUN(no_line_beyond_the_period_is_written);
    RUN(a_player_repeats_its_table_for_ever);
    RUN(a_player_needs_a_table);
    RUN(a_harmonic_is_one_cosine);
    RUN(an_impulse_is_one_sample);
    RUN(noise_is_gaussian_and_white);
    RUN(binary_sequences_have_maximum_length_for_every_number_of_stages);
    RUN(binary_sequences_have_a_flat_spectrum);
    RUN(binary_sequences_can_hold_their_bits);
    RUN(a_chirp_sweeps_its_frequency_and_joins_itself);
    RUN(no_signal_is_longer_than_its_period);
    RUN(other_signals_refuse_what_makes_no_sense_and_write_nothing);
    RUN(a_table_can_be_scaled_to_an_rms);
    RUN(a_long_table_is_scaled_as_exactly_as_a_short_one);
    RUN(a_table_can_be_scaled_to_a_peak);
    RUN(silence_is_a_signal_too);
    RUN(what_cannot_be_scaled_is_left_alone);
    return REPORT();
}
