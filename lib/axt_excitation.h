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
