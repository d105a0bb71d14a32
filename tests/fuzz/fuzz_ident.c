/* The estimator of a running axis, by motion and by counts, of any settings and on any samples.
 *
 * The input is settings, and then operations of a byte each: so many samples of an axis that runs
 * (up to 2016 with one byte, 4096 in all), a reset, or one sample of raw bits. What must hold: the
 * invariants of the estimator, finite answers whenever there is one, counters that only grow, and a
 * sample that is refused touches nothing that was learned. */
#include "axt_encoder.h"
#include "axt_ident.h"
#include "raw.h"

typedef struct {
    axt_plant plant;
    axt_ident ident;
    uint32_t number;
    uint32_t noise;
    uint32_t left; /* samples to run */
} running;

static void expect_invariants(const axt_ident *ident) {
    expect(axt_rls_invariants(&ident->rls));
    axt_estimate e;
    const axt_status status = axt_ident_result(ident, &e);
    expect(status == AXT_OK || (status == AXT_ERROR_NO_DATA && e.valid == 0));
    const axt_real values[] = {
        e.axis.I1,        e.axis.I2,        e.axis.B,         e.axis.K,           e.modal.wn,
        e.modal.wd,       e.modal.zeta,     e.axis_error.I1,  e.axis_error.I2,    e.axis_error.B,
        e.axis_error.K,   e.modal_error.wn, e.modal_error.wd, e.modal_error.zeta, e.friction.value,
        e.friction.error, e.friction.t,     e.spring.value,   e.spring.error,     e.spring.t};
    expect(all_finite(values, sizeof values / sizeof values[0]));
}

static bool refused(axt_status status) {
    return status != AXT_OK && status != AXT_ERROR_NO_DATA;
}

static void take_sample(axt_ident *ident, uint32_t number, const axt_motion *motion,
                        const int32_t count[2], axt_real torque) {
    const axt_ident before = *ident;
    const bool counts = ident->regressor.config.counts_per_turn[0] != 0;
    const axt_status status = counts ? axt_ident_counts(ident, number, count[0], count[1], torque)
                                     : axt_ident_motion(ident, number, motion, torque);
    if (refused(status)) {
        expect(memcmp(&ident->rls.theta, &before.rls.theta, sizeof before.rls.theta) == 0);
        expect(memcmp(&ident->scatter, &before.scatter, sizeof before.scatter) == 0);
        expect(ident->samples == before.samples);
    }
    const axt_ident_counters *now = &ident->counters;
    const axt_ident_counters *then = &before.counters;
    const uint32_t more = (now->not_finite - then->not_finite) + (now->range - then->range) +
                          (now->repeated - then->repeated) + (now->jumped - then->jumped);
    expect(more == (refused(status) ? 1U : 0U));
    expect(now->gaps - then->gaps <= 1);
    expect(axt_rls_invariants(&ident->rls));
}

/* An axis under noise for torque. */
static void run(running *r, uint32_t samples) {
    const axt_ident_config *config = &r->ident.regressor.config;
    for (uint32_t i = 0; i < samples && r->left > 0; i++) {
        r->left--;
        r->noise = r->noise * UINT32_C(1664525) + UINT32_C(1013904223);
        const axt_real torque = config->torque * (axt_real)((double)r->noise / 2147483648.0 - 1.0);
        axt_motion motion;
        int32_t count[2] = {0, 0};
        (void)axt_plant_step(&r->plant, torque);
        axt_plant_read(&r->plant, &motion);
        for (int k = 0; k < 2; k++) {
            (void)axt_encoder_read(config->counts_per_turn[k], &motion, (axt_encoder_place)k,
                                   &count[k]);
        }
        take_sample(&r->ident, r->number, &motion, count, torque);
        r->number++;
    }
}

static axt_ident_config take_config(raw_bytes *in) {
    const uint8_t kind = take_byte(in);
    axt_ident_config config = {.form = ((kind & 1) != 0) ? AXT_IDENT_5X4 : AXT_IDENT_3X2,
                               .hold = ((kind & 2) != 0) ? AXT_HOLD_ZERO : AXT_HOLD_LINEAR,
                               .time_step = (axt_real)1e-4,
                               .forgetting = ((kind & 4) != 0) ? (axt_real)0.99 : 1,
                               .torque = (axt_real)0.2};
    if ((kind & 8) != 0) {
        config.counts_per_turn[0] = UINT32_C(1) << (take_byte(in) % 26);
        config.counts_per_turn[1] = UINT32_C(1) << (take_byte(in) % 26);
    }
    if ((kind & 16) != 0) {
        config.torque = take_magnitude(in, 1e-9, 1e9);
        config.time_step = take_magnitude(in, 1e-7, 1);
    }
    if ((kind & 32) != 0) {
        (void)take(in, &config.torque, sizeof config.torque);
        (void)take(in, &config.time_step, sizeof config.time_step);
        (void)take(in, &config.forgetting, sizeof config.forgetting);
    }
    config.expected = take_axis(in, kind >> 6);
    return config;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static running r;
    raw_bytes in = {data, size};
    const axt_ident_config config = take_config(&in);
    r = (running){.number = take_byte(&in), .left = 4096};
    if (axt_ident_init(&r.ident, &config) != AXT_OK ||
        axt_plant_init(&r.plant, &config.expected, config.time_step, &axt_newmark_trapezoidal) !=
            AXT_OK) {
        return 0;
    }
    while (in.left > 0) {
        const uint8_t operation = take_byte(&in);
        if (operation >= 4) {
            run(&r, operation / 4 * 32U);
        } else if (operation == 3) {
            axt_ident_reset(&r.ident);
        } else {
            axt_motion motion = {.twist = 0};
            int32_t count[2] = {0, 0};
            axt_real torque = 0;
            uint32_t number = r.number;
            if (operation == 1) {
                (void)take(&in, &number, sizeof number);
            }
            (void)take(&in, &torque, sizeof torque);
            if (config.counts_per_turn[0] != 0) {
                (void)take(&in, count, sizeof count);
            } else {
                (void)take(&in, &motion, sizeof motion);
            }
            take_sample(&r.ident, number, &motion, count, torque);
            r.number = r.ident.guard.next;
        }
        expect_invariants(&r.ident);
    }
    return 0;
}
