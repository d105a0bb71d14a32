#include "axt_integrator.h"

#include "axt_math.h"

/* Wilson's theta: unconditionally stable above 1.37 (Bathe). */
#define WILSON_THETA AXT_R(1.4)

enum {
    STATES = 4,        /* position, speed, force, ramp of the force */
    TAYLOR_TERMS = 12, /* 0.5^13 / 13! is below the rounding of a double */
    HALVINGS_MAX = 22  /* for matrices up to 2^21 */
};

static void multiply(axt_real a[STATES][STATES], axt_real b[STATES][STATES],
                     axt_real product[STATES][STATES]) {
    for (uint32_t i = 0; i < STATES; i++) {
        for (uint32_t j = 0; j < STATES; j++) {
            axt_real sum = AXT_R(0);
            for (uint32_t k = 0; k < STATES; k++) {
                sum = axt_fma(a[i][k], b[k][j], sum);
            }
            product[i][j] = sum;
        }
    }
}

static void add_scaled(axt_real sum[STATES][STATES], axt_real factor,
                       axt_real term[STATES][STATES]) {
    for (uint32_t i = 0; i < STATES; i++) {
        for (uint32_t j = 0; j < STATES; j++) {
            sum[i][j] = axt_fma(factor, term[i][j], sum[i][j]);
        }
    }
}

/* exp(m) by its power series of m / 2^s, squared s times. What is squared is exp - 1, since
 * (1 + x)^2 - 1 = 2 x + x^2 keeps the digits that the 1 would swallow. On return `m` is exp(m) - 1.
 */
static void exponential_less_one(axt_real m[STATES][STATES]) {
    axt_real largest = AXT_R(0);
    for (uint32_t i = 0; i < STATES; i++) {
        axt_real row = AXT_R(0);
        for (uint32_t j = 0; j < STATES; j++) {
            row += axt_abs(m[i][j]);
        }
        largest = (row > largest) ? row : largest;
    }
    uint32_t halvings = 0;
    axt_real factor = AXT_R(1);
    while (largest * factor > AXT_R(0.5) && halvings < HALVINGS_MAX) {
        factor *= AXT_R(0.5);
        halvings++;
    }
    axt_real term[STATES][STATES] = {{AXT_R(0)}};
    axt_real sum[STATES][STATES] = {{AXT_R(0)}};
    axt_real product[STATES][STATES];
    add_scaled(term, factor, m);
    add_scaled(sum, AXT_R(1), term);
    for (uint32_t n = 2; n <= TAYLOR_TERMS; n++) {
        multiply(term, m, product);
        for (uint32_t i = 0; i < STATES; i++) {
            for (uint32_t j = 0; j < STATES; j++) {
                term[i][j] = product[i][j] * (factor / (axt_real)n);
            }
        }
        add_scaled(sum, AXT_R(1), term);
    }
    for (uint32_t s = 0; s < halvings; s++) {
        multiply(sum, sum, product);
        add_scaled(product, AXT_R(2), sum);
        for (uint32_t i = 0; i < STATES; i++) {
            for (uint32_t j = 0; j < STATES; j++) {
                sum[i][j] = product[i][j];
            }
        }
    }
    for (uint32_t i = 0; i < STATES; i++) {
        for (uint32_t j = 0; j < STATES; j++) {
            m[i][j] = sum[i][j];
        }
    }
}

axt_status axt_exact_map_init(axt_exact_map *map, axt_real damping, axt_real stiffness,
                              axt_real time_step) {
    const axt_real dh = damping * time_step;
    const axt_real kh2 = stiffness * time_step * time_step;
    if (!(time_step > AXT_R(0)) || !(dh >= AXT_R(0) && dh <= AXT_R(1e6)) ||
        !(kh2 >= AXT_R(0) && kh2 <= AXT_R(1e6))) {
        return AXT_ERROR_RANGE;
    }
    /* in steps: s = t / Dt, state x, x' Dt, f Dt^2 and its change over the step */
    axt_real m[STATES][STATES] = {{0, 1, 0, 0}, {-kh2, -dh, 1, 0}, {0, 0, 0, 1}, {0, 0, 0, 0}};
    exponential_less_one(m);
    const axt_real per_step = AXT_R(1) / time_step;
    *map = (axt_exact_map){
        .a = {{m[0][0], m[0][1] * time_step}, {m[1][0] * per_step, m[1][1]}},
        .held = {m[0][2] * time_step * time_step, m[1][2] * time_step},
        .ramp = {m[0][3] * time_step * time_step, m[1][3] * time_step},
    };
    return AXT_OK;
}

static axt_real acceleration_at(const axt_oscillator *o, axt_real position, axt_real speed,
                                axt_real force) {
    return force - o->damping * speed - o->stiffness * position;
}

static void runge_kutta(axt_oscillator *o, axt_real h, axt_real force_before, axt_real force) {
    const axt_real half = AXT_R(0.5) * h;
    const axt_real middle = AXT_R(0.5) * (force_before + force);
    const axt_real v1 = o->speed;
    const axt_real a1 = acceleration_at(o, o->position, v1, force_before);
    const axt_real v2 = o->speed + half * a1;
    const axt_real a2 = acceleration_at(o, o->position + half * v1, v2, middle);
    const axt_real v3 = o->speed + half * a2;
    const axt_real a3 = acceleration_at(o, o->position + half * v2, v3, middle);
    const axt_real v4 = o->speed + h * a3;
    const axt_real a4 = acceleration_at(o, o->position + h * v3, v4, force);
    o->position += h / AXT_R(6) * (v1 + AXT_R(2) * (v2 + v3) + v4);
    o->speed += h / AXT_R(6) * (a1 + AXT_R(2) * (a2 + a3) + a4);
    o->acceleration = acceleration_at(o, o->position, o->speed, force);
}

/* A free step multiplies position and speed by a matrix, here built column by column. Its
 * eigenvalues lie within the unit circle when |determinant| <= 1 and |trace| <= 1 + determinant
 * (Jury). */
static bool runge_kutta_is_stable(const axt_oscillator *o, axt_real h) {
    axt_oscillator moved = *o;
    axt_oscillator kicked = *o;
    moved.position = AXT_R(1);
    kicked.speed = AXT_R(1) / h;
    runge_kutta(&moved, h, AXT_R(0), AXT_R(0));
    runge_kutta(&kicked, h, AXT_R(0), AXT_R(0));
    const axt_real rounding = AXT_R(16) * AXT_EPSILON;
    const axt_real trace = moved.position + kicked.speed * h;
    const axt_real determinant =
        moved.position * (kicked.speed * h) - kicked.position * (moved.speed * h);
    return axt_abs(determinant) <= AXT_R(1) + rounding &&
           axt_abs(trace) <= AXT_R(1) + determinant + rounding;
}

axt_status axt_integrator_init(axt_integrator *integrator, axt_method method, const axt_axis *axis,
                               axt_real time_step) {
    axt_plant limits;
    axt_status status = axt_plant_init(&limits, axis, time_step, &axt_newmark_trapezoidal);
    if (status != AXT_OK) {
        return status;
    }
    if ((uint32_t)method >
        AXT_METHOD_EXACT_HELD) { /* enums are unsigned on Arm, signed elsewhere */
        return AXT_ERROR_RANGE;
    }
    const axt_real inertia = axis->I1 + axis->I2;
    const axt_real per_reduced = AXT_R(1) / axis->I1 + AXT_R(1) / axis->I2;
    axt_integrator fresh = {
        .method = method,
        .time_step = time_step,
        .motor_share = axis->I2 / inertia,
        .torque_max = AXT_PI * inertia / (time_step * time_step),
        .twist = {.damping = axis->B * per_reduced,
                  .stiffness = axis->K * per_reduced,
                  .per_inertia = AXT_R(1) / axis->I1},
        .body = {.per_inertia = AXT_R(1) / inertia},
    };
    if (method == AXT_METHOD_RUNGE_KUTTA && !runge_kutta_is_stable(&fresh.twist, time_step)) {
        return AXT_ERROR_RANGE;
    }
    status =
        axt_exact_map_init(&fresh.twist.map, fresh.twist.damping, fresh.twist.stiffness, time_step);
    if (status == AXT_OK) {
        status = axt_exact_map_init(&fresh.body.map, AXT_R(0), AXT_R(0), time_step);
    }
    if (status == AXT_OK) {
        *integrator = fresh;
    }
    return status;
}

static void set_oscillator(axt_oscillator *o, axt_real position, axt_real speed, axt_real torque) {
    o->position = position;
    o->speed = speed;
    o->acceleration = o->per_inertia * torque - o->damping * speed - o->stiffness * position;
}

static axt_status check_torque(const axt_integrator *integrator, axt_real torque) {
    if (axt_abs(torque) <= integrator->torque_max) {
        return AXT_OK;
    }
    return axt_finite(torque) ? AXT_ERROR_RANGE : AXT_ERROR_NOT_FINITE;
}

axt_status axt_integrator_set(axt_integrator *integrator, const axt_motion *motion,
                              axt_real torque) {
    const axt_status status = check_torque(integrator, torque);
    if (status != AXT_OK) {
        return status;
    }
    if (!axt_finite(motion->twist) || !axt_finite(motion->twist_speed) ||
        !axt_finite(motion->speed) || !axt_finite(motion->fraction)) {
        return AXT_ERROR_NOT_FINITE;
    }
    if (!(axt_abs(motion->twist) <= AXT_R(1e3)) || !(axt_abs(motion->twist_speed) <= AXT_R(1e9)) ||
        !(axt_abs(motion->speed) * integrator->time_step < AXT_PI) ||
        !(axt_abs(motion->fraction) <= AXT_R(1))) {
        return AXT_ERROR_RANGE;
    }
    const axt_real share = integrator->motor_share;
    set_oscillator(&integrator->twist, motion->twist, motion->twist_speed, torque);
    set_oscillator(&integrator->body, AXT_TWO_PI * motion->fraction - share * motion->twist,
                   motion->speed - share * motion->twist_speed, torque);
    integrator->torque = torque;
    integrator->steps = 0;
    return AXT_OK;
}

/* Eqs. 4-6 with 1/4, 1/2, solved for the acceleration at the end of the step. */
static void newmark(axt_oscillator *o, axt_real h, axt_real force) {
    const axt_real speed = o->speed + AXT_R(0.5) * h * o->acceleration;
    const axt_real position = o->position + h * o->speed + AXT_R(0.25) * h * h * o->acceleration;
    const axt_real mass =
        AXT_R(1) + AXT_R(0.5) * h * o->damping + AXT_R(0.25) * h * h * o->stiffness;
    o->acceleration = (force - o->damping * speed - o->stiffness * position) / mass;
    o->speed = speed + AXT_R(0.5) * h * o->acceleration;
    o->position = position + AXT_R(0.25) * h * h * o->acceleration;
}

/* x'' = (2 x1 - 5 x0 + 4 x-1 - x-2) / h^2, x' = (11 x1 - 18 x0 + 9 x-1 - 2 x-2) / 6 h, put into the
 * equation of motion at the end of the step. */
static void houbolt(axt_oscillator *o, axt_real h, axt_real force) {
    const axt_real acceleration =
        (AXT_R(-5) * o->position + AXT_R(4) * o->before[0] - o->before[1]) / (h * h);
    const axt_real speed =
        (AXT_R(-18) * o->position + AXT_R(9) * o->before[0] - AXT_R(2) * o->before[1]) /
        (AXT_R(6) * h);
    const axt_real mass =
        AXT_R(2) / (h * h) + AXT_R(11) / (AXT_R(6) * h) * o->damping + o->stiffness;
    o->position = (force - acceleration - o->damping * speed) / mass;
    o->speed = speed + AXT_R(11) / (AXT_R(6) * h) * o->position;
    o->acceleration = acceleration + AXT_R(2) / (h * h) * o->position;
}

/* The acceleration grows linearly by `change` over theta h; the equation of motion holds there,
 * under the torque extrapolated to there. */
static void wilson(axt_oscillator *o, axt_real h, axt_real force_before, axt_real force) {
    const axt_real tau = WILSON_THETA * h;
    const axt_real far_force = force_before + WILSON_THETA * (force - force_before);
    const axt_real far_speed = o->speed + tau * o->acceleration;
    const axt_real far_position =
        o->position + tau * (o->speed + AXT_R(0.5) * tau * o->acceleration);
    const axt_real mass =
        AXT_R(1) + AXT_R(0.5) * tau * o->damping + tau * tau / AXT_R(6) * o->stiffness;
    const axt_real change =
        (far_force - o->acceleration - o->damping * far_speed - o->stiffness * far_position) /
        mass / WILSON_THETA;
    o->position += h * (o->speed + h * (AXT_R(0.5) * o->acceleration + change / AXT_R(6)));
    o->speed += h * (o->acceleration + AXT_R(0.5) * change);
    o->acceleration += change;
}

static void exact(axt_oscillator *o, axt_real force_before, axt_real force) {
    const axt_exact_map *map = &o->map;
    const axt_real change = force - force_before;
    const axt_real position = o->position;
    const axt_real speed = o->speed;
    o->position += map->a[0][0] * position + map->a[0][1] * speed + map->held[0] * force_before +
                   map->ramp[0] * change;
    o->speed += map->a[1][0] * position + map->a[1][1] * speed + map->held[1] * force_before +
                map->ramp[1] * change;
    o->acceleration = acceleration_at(o, o->position, o->speed, force);
}

static void step_oscillator(const axt_integrator *integrator, axt_oscillator *o, axt_real torque) {
    const axt_real h = integrator->time_step;
    const axt_real before = o->per_inertia * integrator->torque;
    const axt_real force = o->per_inertia * torque;
    const axt_real position = o->position;
    switch (integrator->method) {
    case AXT_METHOD_NEWMARK:
        newmark(o, h, force);
        break;
    case AXT_METHOD_HOUBOLT:
        if (integrator->steps < 2) {
            newmark(o, h, force);
        } else {
            houbolt(o, h, force);
        }
        break;
    case AXT_METHOD_WILSON:
        wilson(o, h, before, force);
        break;
    case AXT_METHOD_RUNGE_KUTTA:
        runge_kutta(o, h, before, force);
        break;
    case AXT_METHOD_EXACT:
        exact(o, before, force);
        break;
    case AXT_METHOD_EXACT_HELD:
        exact(o, before, before);
        break;
    }
    o->before[1] = o->before[0];
    o->before[0] = position;
}

axt_status axt_integrator_step(axt_integrator *integrator, axt_real torque) {
    const axt_status status = check_torque(integrator, torque);
    if (status != AXT_OK) {
        return status;
    }
    step_oscillator(integrator, &integrator->twist, torque);
    step_oscillator(integrator, &integrator->body, torque);
    integrator->torque = torque;
    integrator->steps += (integrator->steps < UINT32_MAX) ? 1U : 0U;
    return AXT_OK;
}

void axt_integrator_read(const axt_integrator *integrator, axt_motion *motion) {
    const axt_oscillator *twist = &integrator->twist;
    const axt_oscillator *body = &integrator->body;
    const axt_real share = integrator->motor_share;
    *motion = (axt_motion){
        .twist = twist->position,
        .twist_speed = twist->speed,
        .speed = body->speed + share * twist->speed,
        .fraction = (body->position + share * twist->position) / AXT_TWO_PI,
    };
}
