/* The drift alarm: as many false alarms as were asked for and no more, changes reported in the time
 * that the chart's formula says, and a real axis whose stiffness changes. */
#include "axt_monitor.h"

#include "axt_encoder.h"
#include "axt_excitation.h"
#include "axt_plant.h"
#include "check.h"
#include "reference.h"

enum { PERIOD = 2048, COUNTS = 1048576, BATCH = 100, LEARNING = 100 };

/* ---- An axis with an estimator ---------------------------------------------------------------*/

typedef struct {
    axt_plant plant;
    axt_ident ident;
    axt_real table[PERIOD];
    axt_real time_step;
    uint32_t sample;
    uint64_t seed;
} bench;

static void bench_start(bench *b, axt_ident_form form, uint64_t seed) {
    axt_modal modal;
    CHECK_EQUAL(axt_axis_modal(&axt_axis_paper, &modal), AXT_OK);
    *b = (bench){.time_step = axt_time_step(PERIOD, 146, modal.wn), .seed = seed};
    const axt_schroeder signal = {
        .length = PERIOD, .first = 1, .stride = 1, .lines = 292, .rms = (axt_real)0.2};
    CHECK_EQUAL(axt_schroeder_fill(&signal, b->table, PERIOD), AXT_OK);
    CHECK_EQUAL(axt_plant_init(&b->plant, &axt_axis_paper, b->time_step, &axt_newmark_trapezoidal),
                AXT_OK);
    const axt_ident_config config = {.form = form,
                                     .time_step = b->time_step,
                                     .forgetting = 1,
                                     .expected = axt_axis_paper,
                                     .torque = (axt_real)0.2,
                                     .counts_per_turn = {COUNTS, COUNTS}};
    CHECK_EQUAL(axt_ident_init(&b->ident, &config), AXT_OK);
}

/* One sample, with a little torque that nobody knows of. */
static axt_status bench_step(bench *b) {
    const axt_real torque = b->table[b->sample % PERIOD];
    const axt_real disturbance = (axt_real)1e-3 * gaussian(&b->seed);
    axt_motion motion;
    int32_t count[2];
    CHECK_EQUAL(axt_plant_step(&b->plant, torque + disturbance), AXT_OK);
    axt_plant_read(&b->plant, &motion);
    CHECK_EQUAL(axt_encoder_read(COUNTS, &motion, AXT_ENCODER_MOTOR, &count[0]), AXT_OK);
    CHECK_EQUAL(axt_encoder_read(COUNTS, &motion, AXT_ENCODER_TABLE, &count[1]), AXT_OK);
    return axt_ident_counts(&b->ident, b->sample++, count[0], count[1], torque);
}

static void bench_stiffen(bench *b, double ratio) {
    axt_axis axis = axt_axis_paper;
    axis.K *= (axt_real)ratio;
    axt_motion motion;
    axt_plant_read(&b->plant, &motion);
    CHECK_EQUAL(axt_plant_init(&b->plant, &axis, b->time_step, &axt_newmark_trapezoidal), AXT_OK);
    CHECK_EQUAL(axt_plant_set(&b->plant, &motion, b->table[(b->sample - 1) % PERIOD]), AXT_OK);
}

static axt_monitor monitor_of(uint32_t batch, uint32_t learning, double false_alarm) {
    const axt_monitor_config config = {batch, learning, (axt_real)false_alarm};
    axt_monitor monitor;
    CHECK_EQUAL(axt_monitor_init(&monitor, &config), AXT_OK);
    return monitor;
}

/* ---- Innovations of known kind: equations without regressors are all innovation ---------------
 */

typedef struct {
    uint64_t seed;
    double size[2];
    double colour[2]; /* of a first-order process */
    double state[2];
} source;

static axt_equation next_equation(source *s) {
    axt_equation equation = {{0}, {0}};
    for (int k = 0; k < 2; k++) {
        const double fresh = (double)gaussian(&s->seed) * sqrt(1 - s->colour[k] * s->colour[k]);
        s->state[k] = s->colour[k] * s->state[k] + fresh;
        equation.y[k] = (axt_real)(s->size[k] * s->state[k]);
    }
    return equation;
}

/* Batches until the alarm rings, at most `most`. */
static uint32_t batches_until_alarm(axt_monitor *monitor, source *s, uint32_t most) {
    for (uint32_t n = 0; n < most * monitor->config.batch; n++) {
        const axt_equation equation = next_equation(s);
        if (axt_monitor_step(monitor, &equation) == AXT_MONITOR_ALARM) {
            return n / monitor->config.batch + 1;
        }
    }
    return most;
}

/* A monitor that has learned this source. */
static axt_monitor taught(source *s, const axt_ident *model, double false_alarm) {
    axt_monitor monitor = monitor_of(BATCH, LEARNING, false_alarm);
    CHECK_EQUAL(axt_monitor_start(&monitor, model), AXT_OK);
    CHECK_EQUAL(monitor.state, AXT_MONITOR_LEARNING);
    for (int n = 0; n < BATCH * LEARNING; n++) {
        const axt_equation equation = next_equation(s);
        (void)axt_monitor_step(&monitor, &equation);
    }
    CHECK_EQUAL(monitor.state, AXT_MONITOR_WATCHING);
    return monitor;
}

static axt_ident some_model(void) {
    static bench b;
    bench_start(&b, AXT_IDENT_3X2, 1);
    while (b.sample < 2 * PERIOD) {
        (void)bench_step(&b);
    }
    return b.ident;
}

/* Asked for one false alarm in 50 batches, a monitor of 50 batches rings in 63 % of all cases; what
 * it learned from is finite, so it is told to be more careful than that. */
CASE(false_alarms_are_as_rare_as_was_asked_for) {
    enum { RUNS = 200, WATCHED = 50 };
    static const double colours[] = {0, 0.7, -0.7};
    const axt_ident model = some_model();
    for (size_t i = 0; i < COUNT_OF(colours); i++) {
        uint32_t rang = 0;
        for (uint32_t run = 0; run < RUNS; run++) {
            source s = {.seed = run + 1, .size = {1, 1e-3}, .colour = {colours[i], colours[i]}};
            axt_monitor monitor = taught(&s, &model, WATCHED);
            (void)batches_until_alarm(&monitor, &s, WATCHED);
            rang += monitor.alarms;
        }
        const double deviation = sqrt(0.63 * 0.37 / RUNS);
        CHECK(rang / (double)RUNS < 0.63 + 3 * deviation);
        CHECK(rang / (double)RUNS > 0.63 / 4);
    }
}

/* The size of white innovations is known in a batch of n to 1 / sqrt(2 n), so 1.3 times as much of
 * it is 4.2 standard deviations; and the colour to 1 / sqrt(n), so 0.4 of it is 4. */
CASE(a_change_is_reported_in_the_time_that_the_chart_takes_and_named) {
    static const struct {
        source after;
        uint32_t reasons;
        double deviations;
    } changes[] = {
        {{.size = {1.3, 1}}, AXT_MONITOR_TWIST_SIZE, 4.2},
        {{.size = {1, 1.3}}, AXT_MONITOR_BODY_SIZE, 4.2},
        {{.size = {1, 1}, .colour = {0.4, 0}}, AXT_MONITOR_TWIST_COLOUR, 4},
        {{.size = {1, 1}, .colour = {0, -0.4}}, AXT_MONITOR_BODY_COLOUR, 4},
    };
    const axt_ident model = some_model();
    for (size_t i = 0; i < COUNT_OF(changes); i++) {
        double mean = 0;
        double expected = 0;
        for (uint32_t run = 0; run < 50; run++) {
            source s = {.seed = run + 1, .size = {1, 1}};
            axt_monitor monitor = taught(&s, &model, 1e6);
            source after = changes[i].after;
            after.seed = s.seed;
            const uint32_t batches = batches_until_alarm(&monitor, &after, 100);
            mean += batches / 50.0;
            expected += (1 + (double)monitor.limit / (changes[i].deviations - 1)) / 50;
            CHECK_EQUAL(monitor.state, AXT_MONITOR_ALARM);
            CHECK((monitor.reasons & changes[i].reasons) != 0);
            CHECK_EQUAL(monitor.alarms, 1);
        }
        CHECK_NEAR(mean / expected, 1, 0.35);
    }
}

/* ---- A real axis ----------------------------------------------------------------------------- */

CASE(an_axis_whose_stiffness_changes_by_two_per_cent_is_found_to) {
    static const axt_ident_form forms[] = {AXT_IDENT_3X2, AXT_IDENT_5X4};
    for (uint32_t run = 0; run < 8; run++) {
        static bench b;
        bench_start(&b, forms[run % 2], run + 1);
        axt_monitor monitor = monitor_of(256, 40, 1e6);
        CHECK_EQUAL(axt_monitor_start(&monitor, &b.ident), AXT_ERROR_NO_DATA);
        CHECK_EQUAL(monitor.state, AXT_MONITOR_OFF);
        uint32_t watched = 0; /* samples */
        uint32_t changed = 0;
        while (monitor.state != AXT_MONITOR_ALARM && changed < 20 * 256) {
            if (b.sample == 4 * PERIOD) {
                CHECK_EQUAL(axt_monitor_start(&monitor, &b.ident), AXT_OK);
            }
            if (bench_step(&b) == AXT_OK) {
                (void)axt_monitor_step(&monitor, &b.ident.equation);
            }
            watched += (monitor.state == AXT_MONITOR_WATCHING) ? 1U : 0U;
            if (watched == 20 * 256) {
                CHECK_EQUAL(monitor.alarms, 0);
                bench_stiffen(&b, (run % 4 < 2) ? 1.02 : 0.98);
            }
            changed += (watched > 20 * 256) ? 1U : 0U;
        }
        CHECK_EQUAL(monitor.state, AXT_MONITOR_ALARM);
        CHECK(changed > 0 && changed <= 10 * 256);
        CHECK((monitor.reasons & (AXT_MONITOR_TWIST_SIZE | AXT_MONITOR_TWIST_COLOUR)) != 0);
    }
}

/* ---- States ---------------------------------------------------------------------------------- */

CASE(a_monitor_that_was_not_started_does_nothing) {
    axt_monitor monitor = monitor_of(BATCH, LEARNING, 1000);
    const axt_monitor before = monitor;
    const axt_equation equation = {{1, 1, 1, 1, 1}, {1, 1, 1, 1}};
    for (int n = 0; n < 1000; n++) {
        CHECK_EQUAL(axt_monitor_step(&monitor, &equation), AXT_MONITOR_OFF);
    }
    CHECK(UNCHANGED(monitor, before));
}

CASE(an_alarm_stays_until_a_new_start) {
    const axt_ident model = some_model();
    source s = {.seed = 1, .size = {1, 1}};
    axt_monitor monitor = taught(&s, &model, 1e6);
    s.size[0] = 10;
    (void)batches_until_alarm(&monitor, &s, 100);
    s.size[0] = 1;
    const axt_monitor alarmed = monitor;
    (void)batches_until_alarm(&monitor, &s, 10);
    CHECK(UNCHANGED(monitor, alarmed));
    monitor.alarms = UINT32_MAX; /* the counter stops at its end */
    CHECK_EQUAL(axt_monitor_start(&monitor, &model), AXT_OK);
    CHECK_EQUAL(monitor.state, AXT_MONITOR_LEARNING);
    CHECK_EQUAL(monitor.reasons, 0);
    (void)batches_until_alarm(&monitor, &s, LEARNING);
    s.size[1] = 10;
    (void)batches_until_alarm(&monitor, &s, 100);
    CHECK_EQUAL(monitor.state, AXT_MONITOR_ALARM);
    CHECK_EQUAL(monitor.alarms, UINT32_MAX);
}

CASE(innovations_beyond_all_bounds_ring_and_leave_no_number_that_is_none) {
    const axt_ident model = some_model();
    source s = {.seed = 1, .size = {1, 1}};
    axt_monitor monitor = taught(&s, &model, 1e6);
    const axt_real largest = BY_TYPE((axt_real)3e38, (axt_real)1e308);
    const axt_equation huge = {{0}, {largest, -largest}};
    for (int n = 0; n < BATCH; n++) {
        (void)axt_monitor_step(&monitor, &huge);
    }
    CHECK_EQUAL(monitor.state, AXT_MONITOR_ALARM);
    CHECK((monitor.reasons & AXT_MONITOR_TWIST_SIZE) != 0);
    for (int i = 0; i < AXT_MONITOR_ROWS * AXT_MONITOR_CHARTS; i++) {
        CHECK(isfinite(monitor.chart[i / AXT_MONITOR_CHARTS][i % AXT_MONITOR_CHARTS]));
    }
    /* and while it learns they do not spoil what is normal */
    axt_monitor learning = monitor_of(BATCH, LEARNING, 1e6);
    CHECK_EQUAL(axt_monitor_start(&learning, &model), AXT_OK);
    for (int n = 0; n < BATCH; n++) {
        (void)axt_monitor_step(&learning, &huge);
    }
    (void)batches_until_alarm(&learning, &s, LEARNING);
    CHECK_EQUAL(learning.state, AXT_MONITOR_WATCHING);
    CHECK_NEAR(learning.size[0].mean, 1, 0.1);
}

CASE(an_axis_without_any_noise_is_watched_too) {
    const axt_ident model = some_model();
    source s = {.seed = 1, .size = {0, 0}};
    axt_monitor monitor = taught(&s, &model, 1000);
    CHECK_EQUAL(batches_until_alarm(&monitor, &s, 1000), 1000);
    CHECK_EQUAL(monitor.alarms, 0);
    s.size[1] = 1e-6;
    CHECK_EQUAL(batches_until_alarm(&monitor, &s, 100), 1);
}

CASE(settings_that_make_no_sense_are_refused_and_nothing_is_written) {
    axt_monitor monitor = monitor_of(BATCH, LEARNING, 1000);
    const axt_monitor before = monitor;
    static const struct {
        uint32_t batch;
        uint32_t learning;
        float false_alarm;
    } bad[] = {{99, 20, 100},  {0, 20, 100},       {100, 19, 100}, {100, 20, 9},
               {100, 20, NAN}, {100, 20, 1.1e12F}, {100, 20, -1}};
    for (size_t i = 0; i < COUNT_OF(bad); i++) {
        const axt_monitor_config config = {bad[i].batch, bad[i].learning,
                                           (axt_real)bad[i].false_alarm};
        CHECK_EQUAL(axt_monitor_init(&monitor, &config), AXT_ERROR_RANGE);
    }
    CHECK(UNCHANGED(monitor, before));
    (void)monitor_of(100, 20, 10);
    (void)monitor_of(UINT32_MAX, UINT32_MAX, 1e12);
}

int main(void) {
    RUN(false_alarms_are_as_rare_as_was_asked_for);
    RUN(a_change_is_reported_in_the_time_that_the_chart_takes_and_named);
    RUN(an_axis_whose_stiffness_changes_by_two_per_cent_is_found_to);
    RUN(a_monitor_that_was_not_started_does_nothing);
    RUN(an_alarm_stays_until_a_new_start);
    RUN(innovations_beyond_all_bounds_ring_and_leave_no_number_that_is_none);
    RUN(an_axis_without_any_noise_is_watched_too);
    RUN(settings_that_make_no_sense_are_refused_and_nothing_is_written);
    return REPORT();
}
