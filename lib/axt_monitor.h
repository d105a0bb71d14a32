/* axt_monitor.h - a drift alarm: does the axis still behave like the model that was found?
 *
 * The model is kept as it was when the monitor was started, and its innovations e, what it does not
 * explain of each new equation, are watched: the estimator may follow a change, the monitor does
 * not. Innovations of filtered signals are neither white nor of a size that is known beforehand, so
 * what is normal is learned first. Samples are taken in batches, and of each batch, for the twist's
 * and the body's row,
 *
 *     their size      sqrt(sum e^2 / n)
 *     their colour    sum e[k] e[k-1] / sum e^2
 *
 * Both are nearly normal, as sums over many samples are. After the batches of learning each is
 * standardised to z by the mean and the standard deviation that it had there, and put on a
 * cumulative sum chart (E. S. Page, Biometrika 41 (1954) 100-115),
 *
 *     S <- max(0, S + z - 1),  alarm when S > h
 *
 * for a larger size, and for a colour that goes up or down: six charts. From false alarm to false
 * alarm such a chart runs (exp(2 b) - 2 b - 1) / 2 batches on average, b = h + 1.166 (D. Siegmund,
 * Sequential Analysis, 1985); h is chosen so that six charts together run `false_alarm` batches. A
 * change by s standard deviations, s > 1, is reported after about 1 + h / (s - 1) batches.
 *
 * An axis that moves quite otherwise than while it was learned from may ring the alarm with nothing
 * wrong: what the model leaves unexplained may then be more. Learn in the operation to be watched.
 */
#ifndef AXT_MONITOR_H
#define AXT_MONITOR_H

#include "axt_ident.h"
#include "axt_real.h"
#include "axt_regressor.h"
#include "axt_rls.h"
#include "axt_status.h"

enum { AXT_MONITOR_ROWS = 2, AXT_MONITOR_CHARTS = 3 };

typedef struct {
    uint32_t batch;       /* samples of a batch, 100 or more: many correlation times of the noise */
    uint32_t learning;    /* batches to learn from, 20 or more */
    axt_real false_alarm; /* mean number of batches between false alarms, 10 .. 1e12 */
} axt_monitor_config;

typedef enum {
    AXT_MONITOR_OFF = 0,      /* not started */
    AXT_MONITOR_LEARNING = 1, /* what is normal */
    AXT_MONITOR_WATCHING = 2,
    AXT_MONITOR_ALARM = 3 /* the axis has changed; stays until a new start */
} axt_monitor_state;

/* What rang: bits of axt_monitor.reasons. */
enum {
    AXT_MONITOR_TWIST_SIZE = 1,
    AXT_MONITOR_TWIST_COLOUR = 2,
    AXT_MONITOR_BODY_SIZE = 4,
    AXT_MONITOR_BODY_COLOUR = 8
};

/* What is remembered of one quantity: running mean and sum of squared deviations (B. P. Welford),
 * and from the end of learning on 1 / standard deviation in place of the latter. */
typedef struct {
    axt_real mean;
    axt_real deviation;
} axt_normal;

/* `state`, `reasons` and `alarms` are for the caller, the rest is its own business. */
typedef struct {
    axt_monitor_state state;
    uint32_t reasons;
    uint32_t alarms; /* since initialisation, saturating */
    axt_monitor_config config;
    axt_real limit; /* h */
    uint32_t inputs;
    uint32_t row;                                         /* of q'' among the outputs */
    axt_real model[AXT_MONITOR_ROWS][AXT_RLS_INPUTS_MAX]; /* rows of theta as they were */
    axt_real last[AXT_MONITOR_ROWS];                      /* innovations */
    axt_real power[AXT_MONITOR_ROWS];                     /* sums over the batch: e^2, */
    axt_real product[AXT_MONITOR_ROWS];                   /* e[k] e[k-1] */
    axt_normal size[AXT_MONITOR_ROWS];
    axt_normal colour[AXT_MONITOR_ROWS];
    axt_real chart[AXT_MONITOR_ROWS][AXT_MONITOR_CHARTS]; /* S of size, colour up, colour down */
    uint32_t taken;                                       /* samples of the batch so far */
    uint32_t learned;                                     /* batches */
} axt_monitor;

/* AXT_ERROR_RANGE leaves `monitor` unchanged. Cost: at most 20 multiplications. */
axt_status axt_monitor_init(axt_monitor *monitor, const axt_monitor_config *config);

/* Takes what `ident` has found so far as the model, and learns anew what is normal with it.
 * AXT_ERROR_NO_DATA, nothing changed, before axt_ident_result() has an answer. */
axt_status axt_monitor_start(axt_monitor *monitor, const axt_ident *ident);

/* An equation: ident->equation whenever axt_ident_counts() or axt_ident_motion() answers AXT_OK.
 * Returns the state. Cost: one multiply-add for each entry of two rows, and 8 operations; at the
 * end of a batch about 60 and 4 divisions and square roots. */
axt_monitor_state axt_monitor_step(axt_monitor *monitor, const axt_equation *equation);

#endif
