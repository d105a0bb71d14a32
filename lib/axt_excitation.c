#include "axt_excitation.h"

#include "axt_math.h"

enum { LENGTH_MAX = 1048576 };

axt_status axt_schroeder_check(const axt_schroeder *signal) {
    if (!axt_finite(signal->rms)) {
        return AXT_ERROR_NOT_FINITE;
    }
    if (signal->length < 4 || signal->length > LENGTH_MAX || signal->first < 1 ||
        signal->stride < 1 || signal->lines < 1 || !(signal->rms >= AXT_R(0))) {
        return AXT_ERROR_RANGE;
    }
    const uint64_t last =
        (uint64_t)signal->first + (uint64_t)signal->stride * (uint64_t)(signal->lines - 1);
    return (last <= (signal->length - 1) / 2) ? AXT_OK : AXT_ERROR_RANGE;
}

/* Schroeder's phase of line i = 1 .. L for a flat spectrum, - pi i (i - 1) / L, in turns within 0
 * .. 1: i (i - 1) is reduced in integers, so the phase is exact for any L. */
static axt_real schroeder_turns(uint32_t i, uint32_t lines) {
    const uint64_t period = 2 * (uint64_t)lines;
    const uint64_t square = (uint64_t)i * (uint64_t)(i - 1) % period;
    return (axt_real)((period - square) % period) / (axt_real)period;
}

/* A well mixed phase in turns within 0 .. 1 from seed and line number (the finaliser of
 * MurmurHash3). */
static axt_real random_turns(uint32_t seed, uint32_t i) {
    uint32_t x = seed * UINT32_C(0x9E3779B9) + i;
    x = (x ^ (x >> 16)) * UINT32_C(0x85EBCA6B);
    x = (x ^ (x >> 13)) * UINT32_C(0xC2B2AE35);
    x ^= x >> 16;
    return (axt_real)(x >> 8) / AXT_R(16777216);
}

axt_status axt_schroeder_add_line(const axt_schroeder *signal, uint32_t index, axt_real *table) {
    const axt_status status = axt_schroeder_check(signal);
    if (status != AXT_OK) {
        return status;
    }
    if (index >= signal->lines) {
        return AXT_ERROR_RANGE;
    }
    const uint32_t harmonic = signal->first + signal->stride * index;
    const axt_real phase = (signal->seed == 0) ? schroeder_turns(index + 1, signal->lines)
                                               : random_turns(signal->seed, index + 1);
    const axt_real amplitude = signal->rms * axt_sqrt(AXT_R(2) / (axt_real)signal->lines);
    /* harmonic x n modulo length, kept in integers: the argument of the cosine never grows */
    uint32_t step = 0;
    for (uint32_t n = 0; n < signal->length; n++) {
        axt_real turns = (axt_real)step / (axt_real)signal->length + phase;
        turns -= (turns >= AXT_R(0.5)) ? AXT_R(1) : AXT_R(0);
        table[n] += amplitude * axt_cos(AXT_TWO_PI * turns);
        step = (step + harmonic) % signal->length;
    }
    return AXT_OK;
}

axt_status axt_schroeder_fill(const axt_schroeder *signal, axt_real *table, uint32_t size) {
    const axt_status status = axt_schroeder_check(signal);
    if (status != AXT_OK) {
        return status;
    }
    if (size < signal->length) {
        return AXT_ERROR_SIZE;
    }
    for (uint32_t n = 0; n < signal->length; n++) {
        table[n] = AXT_R(0);
    }
    for (uint32_t line = 0; line < signal->lines; line++) {
        (void)axt_schroeder_add_line(signal, line, table); /* checked above */
    }
    return AXT_OK;
}

axt_status axt_harmonic_fill(axt_real *table, uint32_t length, uint32_t harmonic) {
    if (length == 0) {
        return AXT_ERROR_SIZE;
    }
    if (length > LENGTH_MAX || harmonic < 1 || 2 * (uint64_t)harmonic >= length) {
        return AXT_ERROR_RANGE;
    }
    uint32_t step = 0;
    for (uint32_t n = 0; n < length; n++) {
        table[n] = axt_cos(AXT_TWO_PI * ((axt_real)step / (axt_real)length));
        step = (step + harmonic) % length;
    }
    return AXT_OK;
}

axt_status axt_impulse_fill(axt_real *table, uint32_t length) {
    if (length == 0) {
        return AXT_ERROR_SIZE;
    }
    for (uint32_t n = 0; n < length; n++) {
        table[n] = (n == 0) ? AXT_R(1) : AXT_R(0);
    }
    return AXT_OK;
}

axt_status axt_noise_fill(axt_real *table, uint32_t length, uint32_t seed) {
    if (length == 0) {
        return AXT_ERROR_SIZE;
    }
    enum { UNIFORMS = 12 }; /* each has variance 1/12 */
    for (uint32_t n = 0; n < length; n++) {
        axt_real sum = AXT_R(0);
        for (uint32_t i = 0; i < UNIFORMS; i++) {
            sum += random_turns(seed, UNIFORMS * n + i) - AXT_R(0.5);
        }
        table[n] = sum;
    }
    return AXT_OK;
}

/* Feedback taps (bit masks) of shift registers with 3 to 20 stages that run through all 2^n - 1
 * states: primitive polynomials, as tabulated for instance by P. H. Bardell et al., Built-In Test
 * for VLSI. */
static const uint32_t binary_taps[] = {0x6,    0xC,    0x14,    0x30,    0x60,    0xB8,
                                       0x110,  0x240,  0x500,   0xE08,   0x1C80,  0x3802,
                                       0x6000, 0xD008, 0x12000, 0x20400, 0x72000, 0x90000};
enum { STAGES_MIN = 3, STAGES_MAX = 20 };

axt_status axt_binary_fill(axt_real *table, uint32_t length, uint32_t stages, uint32_t hold) {
    if (stages < STAGES_MIN || stages > STAGES_MAX || hold < 1) {
        return AXT_ERROR_RANGE;
    }
    const uint32_t bits = (UINT32_C(1) << stages) - 1;
    if (length != (uint64_t)bits * hold) {
        return AXT_ERROR_SIZE;
    }
    const uint32_t taps = binary_taps[stages - STAGES_MIN];
    uint32_t state = 1;
    for (uint32_t bit = 0; bit < bits; bit++) {
        for (uint32_t i = 0; i < hold; i++) {
            table[bit * hold + i] = ((state & 1U) != 0) ? AXT_R(1) : AXT_R(-1);
        }
        /* Galois form: shift out, and where a one leaves, turn the tapped bits over */
        state = (state >> 1) ^ (((state & 1U) != 0) ? taps : 0U);
    }
    return AXT_OK;
}

axt_status axt_chirp_fill(axt_real *table, uint32_t length, uint32_t first, uint32_t last) {
    if (length == 0) {
        return AXT_ERROR_SIZE;
    }
    if (length > LENGTH_MAX || first < 1 || last <= first || 2 * (uint64_t)last >= length) {
        return AXT_ERROR_RANGE;
    }
    /* phase = first s + (last - first) s^2 / 2 turns at s = n / length; it ends on a whole number
     * of half turns, so a sweep of odd length gets one more half turn to close */
    const uint64_t N = length;
    const uint64_t sweep = (last - first) + ((last - first) & 1U);
    const uint64_t modulus = 2 * N * N; /* one turn, in units of 1 / (2 N^2) */
    for (uint64_t n = 0; n < N; n++) {
        const uint64_t phase = (2 * N * first * n + sweep * n * n) % modulus;
        table[n] = axt_cos(AXT_TWO_PI * ((axt_real)phase / (axt_real)modulus));
    }
    return AXT_OK;
}

axt_status axt_table_scale_to_rms(axt_real *table, uint32_t length, axt_real rms) {
    if (!(rms >= AXT_R(0)) || !axt_finite(rms)) {
        return AXT_ERROR_RANGE;
    }
    /* what each addition rounds off goes into the next: in float, a plain sum of 2^20 equal squares
     * is off by a per cent */
    axt_two sum = {AXT_R(0), AXT_R(0)};
    for (uint32_t n = 0; n < length; n++) {
        sum = axt_two_sum(sum.hi, axt_fma(table[n], table[n], sum.lo));
    }
    if (!(sum.hi > AXT_R(0)) || !axt_finite(sum.hi)) {
        return AXT_ERROR_NO_DATA;
    }
    const axt_real factor = rms / axt_sqrt(sum.hi / (axt_real)length);
    for (uint32_t n = 0; n < length; n++) {
        table[n] *= factor;
    }
    return AXT_OK;
}

axt_status axt_table_scale_to_peak(axt_real *table, uint32_t length, axt_real peak) {
    if (!(peak >= AXT_R(0)) || !axt_finite(peak)) {
        return AXT_ERROR_RANGE;
    }
    axt_real largest = AXT_R(0);
    for (uint32_t n = 0; n < length; n++) {
        const axt_real size = axt_abs(table[n]);
        largest = (size > largest) ? size : largest;
    }
    if (!(largest > AXT_R(0)) || !axt_finite(largest)) {
        return AXT_ERROR_NO_DATA;
    }
    for (uint32_t n = 0; n < length; n++) {
        table[n] = table[n] / largest * peak;
    }
    return AXT_OK;
}

axt_status axt_player_init(axt_player *player, const axt_real *table, uint32_t length) {
    if (length == 0) {
        return AXT_ERROR_SIZE;
    }
    *player = (axt_player){.table = table, .length = length, .next = 0};
    return AXT_OK;
}

axt_real axt_player_step(axt_player *player) {
    const axt_real sample = player->table[player->next];
    player->next++;
    if (player->next >= player->length) {
        player->next = 0;
    }
    return sample;
}
