#include "axt_monitor.h"

#include "axt_math.h"

/* Siegmund's correction for what a chart overshoots its limit by. */
#define OVERSHOOT AXT_R(1.166)

/* Standard deviations that are learned from few batches are too small as often as too large, and
 * too small a one costs more. At 25 batches this is 1.2, at 100 it is 1.1. */
static axt_real caution(uint32_t batches) {
    return AXT_R(1) + AXT_R(1) / axt_sqrt((axt_real)batches);
}

/* h for a chart with this many batches between false alarms: the first step of an eighth at which
 * exp(2 b), less what the formula takes off, is that many. */
static axt_real limit_for(axt_real batches) {
    const axt_real step = AXT_R(0.125);
    const axt_real factor = AXT_R(1.2840254166877414); /* exp(2 / 8) */
    axt_real b = AXT_R(0);
    axt_real power = AXT_R(1);
    while (power - AXT_R(2) * b - AXT_R(1) < AXT_R(2) * batches) {
        b += step;
        power *= factor;
    }
    return (b > OVERSHOOT) ? b - OVERSHOOT : AXT_R(0);
}

axt_status axt_monitor_init(axt_monitor *monitor, const axt_monitor_config *config) {
    if (config->batch < 100 || config->learning < 20 ||
        !(config->false_alarm >= AXT_R(10) && config->false_alarm <= AXT_R(1e12))) {
        return AXT_ERROR_RANGE;
    }
    *monitor = (axt_monitor){
        .config = *config,
        .limit = limit_for((axt_real)(AXT_MONITOR_ROWS * AXT_MONITOR_CHARTS) * config->false_alarm),
    };
    return AXT_OK;
}

axt_status axt_monitor_start(axt_monitor *monitor, const axt_ident *ident) {
    axt_estimate estimate;
    if (axt_ident_result(ident, &estimate) != AXT_OK) {
        return AXT_ERROR_NO_DATA;
    }
    const uint32_t row = axt_regressor_row(&ident->regressor);
    axt_monitor fresh = {.state = AXT_MONITOR_LEARNING,
                         .alarms = monitor->alarms,
                         .config = monitor->config,
                         .limit = monitor->limit,
                         .inputs = ident->rls.inputs,
                         .row = row};
    for (uint32_t k = 0; k < AXT_MONITOR_ROWS; k++) {
        for (uint32_t i = 0; i < ident->rls.inputs; i++) {
            fresh.model[k][i] = ident->rls.theta[row + k][i];
        }
    }
    *monitor = fresh;
    return AXT_OK;
}

static void learn(axt_normal *normal, axt_real value, uint32_t count) {
    const axt_real off = value - normal->mean;
    normal->mean += off / (axt_real)count;
    normal->deviation += off * (value - normal->mean);
}

/* A quantity that did not move at all is given a billionth of its size to move by. */
static void finish(axt_normal *normal, uint32_t count) {
    const axt_real variance = normal->deviation / (axt_real)(count - 1);
    const axt_real least = AXT_R(1e-9) * axt_abs(normal->mean) + AXT_R(1e-30);
    const axt_real deviation = axt_sqrt(variance) * caution(count);
    normal->deviation = AXT_R(1) / ((deviation > least) ? deviation : least);
}

/* One step of a chart; true when it rings. */
static bool chart_rings(axt_real *chart, axt_real z, axt_real limit) {
    const axt_real next = *chart + z - AXT_R(1);
    *chart = (next > AXT_R(0)) ? next : AXT_R(0);
    return *chart > limit;
}

static uint32_t watch(axt_monitor *monitor, uint32_t k, axt_real size, axt_real colour) {
    axt_real *chart = monitor->chart[k];
    const axt_normal *usual_size = &monitor->size[k];
    const axt_normal *usual_colour = &monitor->colour[k];
    const axt_real z = (colour - usual_colour->mean) * usual_colour->deviation;
    const bool up = chart_rings(&chart[1], z, monitor->limit);
    const bool down = chart_rings(&chart[2], -z, monitor->limit);
    uint32_t reasons = (up || down) ? AXT_MONITOR_TWIST_COLOUR : 0;
    if (!axt_finite(size) ||
        chart_rings(&chart[0], (size - usual_size->mean) * usual_size->deviation, monitor->limit)) {
        reasons |= AXT_MONITOR_TWIST_SIZE;
    }
    return reasons << (2 * k);
}

AXT_SEPARATE void close_batch(axt_monitor *monitor) {
    const bool learning = monitor->state == AXT_MONITOR_LEARNING;
    monitor->learned += learning ? 1U : 0U;
    uint32_t reasons = 0;
    for (uint32_t k = 0; k < AXT_MONITOR_ROWS; k++) {
        const axt_real power = monitor->power[k];
        const axt_real size = axt_sqrt(power / (axt_real)monitor->config.batch);
        const bool usable = power > AXT_R(0) && axt_finite(power);
        const axt_real colour = usable ? monitor->product[k] / power : AXT_R(0);
        if (!learning) {
            reasons |= watch(monitor, k, size, colour);
        } else if (axt_finite(size)) {
            learn(&monitor->size[k], size, monitor->learned);
            learn(&monitor->colour[k], colour, monitor->learned);
        }
        monitor->power[k] = AXT_R(0);
        monitor->product[k] = AXT_R(0);
    }
    monitor->taken = 0;
    if (learning && monitor->learned == monitor->config.learning) {
        for (uint32_t k = 0; k < AXT_MONITOR_ROWS; k++) {
            finish(&monitor->size[k], monitor->learned);
            finish(&monitor->colour[k], monitor->learned);
        }
        monitor->state = AXT_MONITOR_WATCHING;
    }
    if (reasons != 0) {
        monitor->state = AXT_MONITOR_ALARM;
        monitor->reasons = reasons;
        axt_count(&monitor->alarms);
    }
}

axt_monitor_state axt_monitor_step(axt_monitor *monitor, const axt_equation *equation) {
    if (monitor->state != AXT_MONITOR_LEARNING && monitor->state != AXT_MONITOR_WATCHING) {
        return monitor->state;
    }
    for (uint32_t k = 0; k < AXT_MONITOR_ROWS; k++) {
        axt_real innovation = equation->y[monitor->row + k];
        for (uint32_t i = 0; i < monitor->inputs; i++) {
            innovation = axt_fma(-monitor->model[k][i], equation->phi[i], innovation);
        }
        monitor->power[k] = axt_fma(innovation, innovation, monitor->power[k]);
        monitor->product[k] = axt_fma(innovation, monitor->last[k], monitor->product[k]);
        monitor->last[k] = innovation;
    }
    monitor->taken++;
    if (monitor->taken == monitor->config.batch) {
        close_batch(monitor);
    }
    return monitor->state;
}
