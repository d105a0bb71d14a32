/* The plant, of any axis and any state, under any torque.
 *
 * The input is a byte that says where the axis comes from, the axis, the time step and Newmark's
 * constants, a motion, and then torques, up to 60 of them: raw bits, or raw bits squeezed into the
 * range that is taken. What must hold: the motion stays finite, the state within the bounds that
 * `make proof` proves, encoders can be read, and what is refused changes nothing but its counter.
 */
#include "axt_encoder.h"
#include "axt_plant.h"
#include "raw.h"

static bool within(axt_real value, axt_real most) {
    return value >= -most && value <= most; /* not of not-a-number */
}

static void expect_invariants(const axt_plant *plant) {
    const axt_plant_state *state = &plant->state;
    const axt_real slightly_more = (axt_real)1.000001 * plant->half_turn;
    expect(within(state->twist_ahead, slightly_more));
    expect(within(state->rate_ahead, 3 * plant->half_turn));
    expect(within(state->impulse, slightly_more));
    expect(within(state->travel, slightly_more));
    const axt_real low = plant->half_turn / 8192;
    expect(within(state->impulse_low, low) && within(state->travel_low, low));
    expect(all_finite(&state->change, 1) && all_finite(&state->torque, 1));
    axt_motion motion;
    axt_plant_read(plant, &motion);
    const axt_real read[] = {motion.twist, motion.twist_speed, motion.speed, motion.fraction,
                             motion.fraction_low};
    expect(all_finite(read, sizeof read / sizeof read[0]));
    for (int place = 0; place < 2; place++) {
        int32_t count = 0;
        const axt_status status =
            axt_encoder_read(AXT_ENCODER_COUNTS_MAX, &motion, (axt_encoder_place)place, &count);
        expect(status == AXT_OK || (status < 0 && count == 0));
    }
}

static void expect_refused(const axt_plant *plant, axt_plant before, uint32_t rejected) {
    before.rejected += rejected;
    expect(memcmp(plant, &before, sizeof before) == 0);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    raw_bytes in = {data, size};
    const uint8_t kind = take_byte(&in);
    const axt_axis axis = take_axis(&in, kind);
    axt_newmark newmark = axt_newmark_trapezoidal;
    axt_real step = (axt_real)1e-4;
    if ((kind & 4) != 0) {
        step = take_magnitude(&in, 1e-7, 1);
        newmark.alpha = take_magnitude(&in, 0.01, 1);
        newmark.delta = take_magnitude(&in, 0.5, 1);
    }
    axt_plant plant;
    if (axt_plant_init(&plant, &axis, step, &newmark) != AXT_OK) {
        return 0;
    }
    expect_invariants(&plant);

    axt_motion motion;
    axt_real torque;
    if ((kind & 8) != 0 && take(&in, &motion, sizeof motion) && take(&in, &torque, sizeof torque)) {
        const axt_plant before = plant;
        if (axt_plant_set(&plant, &motion, torque) != AXT_OK) {
            expect_refused(&plant, before, 0);
        }
        expect_invariants(&plant);
    }
    while (take(&in, &torque, sizeof torque)) {
        if ((kind & 16) != 0) { /* of a size that it takes */
            torque = plant.half_turn * (axt_real)((double)torque / (1 + fabs((double)torque)));
        }
        const axt_plant before = plant;
        if (axt_plant_step(&plant, torque) != AXT_OK) {
            expect_refused(&plant, before, 1);
        }
        expect_invariants(&plant);
    }
    return 0;
}
