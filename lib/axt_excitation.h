/* axt_excitation.h - periodic excitation signals in a table that the caller owns.
 *
 * Schroeder's multisine (M. R. Schroeder, IEEE Trans. Information Theory 16 (1970) 85-89): L lines
 * of equal amplitude whose phases - pi i (i - 1) / L sweep the lines through one period, which
 * keeps the crest factor near 1.7 however many lines there are.
 *
 * Why a table: L lines cost L rotations a sample (292 lines in the paper's second setting), a table
 * costs one load, repeats exactly after N samples for ever, and is filled outside the interrupt,
 * line by line if need be.
 */
#ifndef AXT_EXCITATION_H
#define AXT_EXCITATION_H

#include "axt_real.h"
#include "axt_status.h"

/* Lines first, first + stride, ... (`lines` of them) of a period of `length` samples. */
typedef struct {
    uint32_t length; /* samples a period, 4 .. 1048576 */
    uint32_t first;  /* first harmonic, 1 or more */
    uint32_t stride; /* distance between lines, 1 or more (2: odd lines only) */
    uint32_t lines;  /* number of lines, 1 or more; the last one below length / 2 */
    uint32_t seed;   /* 0: Schroeder's phases; any other number: random phases drawn from it */
    axt_real rms;    /* of the whole signal, in the unit wanted (N m), 0 or more */
} axt_schroeder;

/* AXT_OK, AXT_ERROR_RANGE or AXT_ERROR_NOT_FINITE. */
axt_status axt_schroeder_check(const axt_schroeder *signal);

/* Adds line `index` (0 .. lines - 1) to table[0 .. length - 1]. Cost: length cosines.
 * Fails as axt_schroeder_check(), and with AXT_ERROR_RANGE for an index too large; the table is
 * then unchanged. */
axt_status axt_schroeder_add_line(const axt_schroeder *signal, uint32_t index, axt_real *table);

/* Writes the whole period: clears the table and adds all lines. `size` is the table's number of
 * entries: AXT_ERROR_SIZE when the period does not fit. Cost: length x lines cosines. */
axt_status axt_schroeder_fill(const axt_schroeder *signal, axt_real *table, uint32_t size);

/* The other signals that the paper names as future work; each fills table[0 .. length - 1] with one
 * period of size 1 (largest magnitude, or rms for the noise), to be scaled with
 * axt_table_scale_to_rms() or _to_peak(). AXT_ERROR_SIZE for a length of 0 (and as said),
 * AXT_ERROR_RANGE for the rest; the table is then unchanged. */

/* `harmonic` (1 .. (length - 1) / 2) cosine periods. */
axt_status axt_harmonic_fill(axt_real *table, uint32_t length, uint32_t harmonic);

/* One sample of 1, the rest 0. */
axt_status axt_impulse_fill(axt_real *table, uint32_t length);

/* Gaussian white noise from `seed`: sums of twelve uniform numbers, so nothing beyond 6 sigma. */
axt_status axt_noise_fill(axt_real *table, uint32_t length, uint32_t seed);

/* Maximum-length binary sequence of a shift register with 3 .. 20 stages: +-1, flat spectrum.
 * AXT_ERROR_SIZE unless length is 2^stages - 1, times `hold` samples a bit (1 or more). */
axt_status axt_binary_fill(axt_real *table, uint32_t length, uint32_t stages, uint32_t hold);

/* A sweep from harmonic `first` to `last` (1 <= first < last < length / 2) in one period, frequency
 * growing linearly; it joins itself without a jump. */
axt_status axt_chirp_fill(axt_real *table, uint32_t length, uint32_t first, uint32_t last);

/* Scales the table to this rms. Fails as axt_table_scale_to_peak(). */
axt_status axt_table_scale_to_rms(axt_real *table, uint32_t length, axt_real rms);

/* Scales table[0 .. length - 1] so that its largest magnitude is `peak`. AXT_ERROR_NO_DATA and
 * unchanged when the table is all zero, AXT_ERROR_RANGE when peak is negative or not finite. */
axt_status axt_table_scale_to_peak(axt_real *table, uint32_t length, axt_real peak);

/* A table being played in a circle. */
typedef struct {
    const axt_real *table;
    uint32_t length;
    uint32_t next; /* index of the sample that comes next */
} axt_player;

/* Starts at the first sample. AXT_ERROR_SIZE when length is 0. */
axt_status axt_player_init(axt_player *player, const axt_real *table, uint32_t length);

/* The next sample. Cost: a load, an increment and a compare. Never fails. */
axt_real axt_player_step(axt_player *player);

#endif
