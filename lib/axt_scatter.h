/* axt_scatter.h - how much an estimate scatters, whatever the colour of the noise.
 *
 * The textbook covariance s^2 P holds for white residuals. Those of filtered signals are coloured
 * by the filter, and those of measured speeds by the differences that are taken of them. What least
 * squares leave is theta - truth = P (sum of phi e), whose covariance is
 *
 *     P M P,   M = covariance of the sum of the scores phi e
 *
 * M is the spectrum of the scores at frequency zero. It is estimated from windowed sums g of them:
 * M = 3/2 sum of g g' over triangular windows that overlap by half (P. D. Welch, IEEE Trans. Audio
 * Electroacoust. 15 (1967) 70-73). Sums over plain batches do not serve: the scores of noise that
 * was differenced cancel but for what is left at the ends of a batch, and that outweighs the rest.
 *
 * An estimator that forgets keeps less information than M has seen, and not the same share of it in
 * all directions. M is therefore scaled, regressor by regressor, by the square root of what is
 * kept, 1 / P, over what was seen, the sum of phi^2.
 */
#ifndef AXT_SCATTER_H
#define AXT_SCATTER_H

#include "axt_real.h"
#include "axt_rls.h"
#include "axt_status.h"

enum {
    AXT_SCATTER_ROWS = 2,
    AXT_SCATTER_SCORES_MAX = AXT_SCATTER_ROWS * AXT_RLS_INPUTS_MAX,
    AXT_SCATTER_SUMS_MAX = AXT_SCATTER_SCORES_MAX * (AXT_SCATTER_SCORES_MAX + 1) / 2,
    AXT_SCATTER_LENGTH_MIN = AXT_SCATTER_SUMS_MAX
};

typedef struct {
    /* weighted sums of phi e, one row after the other, of three windows: the one that began last,
     * the one that began half a window earlier, and the last one that has ended */
    axt_real score[3][AXT_SCATTER_SCORES_MAX];
    axt_real sum[AXT_SCATTER_SUMS_MAX]; /* 2/3 M, upper triangle by columns */
    axt_real power[AXT_RLS_INPUTS_MAX]; /* sum of phi^2 in the present half window */
    axt_real seen[AXT_RLS_INPUTS_MAX];  /* in all before */
    axt_real slope;                     /* of the window, 1 / length */
    uint32_t inputs;
    uint32_t length;  /* samples of half a window */
    uint32_t taken;   /* of them so far */
    uint8_t rising;   /* which of the three windows began last, */
    uint8_t falling;  /* which earlier, */
    uint8_t whole;    /* and which has ended */
    uint32_t place;   /* of the next element that `whole` is to be added to, and its */
    uint32_t row;     /* row */
    uint32_t column;  /* and column */
    uint32_t windows; /* in `sum`; at 4096 all of it is halved */
    bool halving;
} axt_scatter;

/* inputs 1 .. 5; `length` of half a window in samples, AXT_SCATTER_LENGTH_MIN or more: many
 * correlation times of the noise. AXT_ERROR_RANGE leaves `scatter` unchanged. */
axt_status axt_scatter_init(axt_scatter *scatter, uint32_t inputs, uint32_t length);

void axt_scatter_reset(axt_scatter *scatter);

/* A sample that was learned from: its regressors, and what it leaves unexplained in the two rows
 * (innovation x certainty). Cost: 5 multiply-adds for each input, and one more while an ended
 * window is added to M, an element a sample; 20 moves at the end of each half window. */
void axt_scatter_add(axt_scatter *scatter, const axt_real *phi, const axt_real *residual);

/* Variance of a function of the entries theta[row][input] with these derivatives, when P is the
 * estimator's and `share` is the variance of an estimate over that of one that has as much
 * information and weighs all of it alike: 1 without forgetting, 1 / (1 + lambda) when settled.
 * Negative while there are too few windows to say. Cost: some hundred operations: not for the
 * interrupt. */
axt_real axt_scatter_variance(const axt_scatter *scatter, const axt_rls *rls, axt_real share,
                              axt_real gradient[AXT_SCATTER_ROWS][AXT_RLS_INPUTS_MAX]);

/* Whether there are windows enough: a few more than parameters in a row. */
bool axt_scatter_known(const axt_scatter *scatter);

#endif
