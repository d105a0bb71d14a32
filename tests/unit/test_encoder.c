/* Encoders: counts against extended precision, exact whatever the turns, and across the wrap. */
#include "axt_encoder.h"

#include "check.h"
#include "reference.h"

static const uint32_t resolutions[] = {1, 10000, 1048576, AXT_ENCODER_COUNTS_MAX, 1000003};

static axt_motion random_motion(uint64_t *seed) {
    return (axt_motion){.twist = uniform(seed, -1e-3, 1e-3),
                        .turns = (int32_t)(uint32_t)random_bits(seed),
                        .fraction = uniform(seed, -0.6, 0.6),
                        .fraction_low = uniform(seed, -1e-8, 1e-8)};
}

/* Where the encoder stands, in counts from the last whole turn. */
static wide position_in_turn(uint32_t counts_per_turn, const axt_motion *motion,
                             axt_encoder_place place) {
    wide turns = (wide)motion->fraction + (wide)motion->fraction_low;
    if (place == AXT_ENCODER_TABLE) {
        turns -= (wide)motion->twist / (2 * PI);
    }
    return turns * counts_per_turn;
}

/* The count lies within half a count of the position (and `slack`, the rounding of the twist). */
static void check_count(uint32_t counts_per_turn, const axt_motion *motion, axt_encoder_place place,
                        double slack) {
    int32_t count = 0;
    CHECK_EQUAL(axt_encoder_read(counts_per_turn, motion, place, &count), AXT_OK);
    const uint32_t at_turn = (uint32_t)((uint64_t)(int64_t)motion->turns * counts_per_turn);
    const int32_t in_turn = (int32_t)((uint32_t)count - at_turn);
    CHECK_NEAR(in_turn - position_in_turn(counts_per_turn, motion, place), 0, 0.5 + slack);
}

CASE(the_count_is_the_nearest_at_any_number_of_turns) {
    uint64_t seed = 1;
    for (int n = 0; n < 100000; n++) {
        const axt_motion motion = random_motion(&seed);
        for (size_t i = 0; i < COUNT_OF(resolutions); i++) {
            check_count(resolutions[i], &motion, AXT_ENCODER_MOTOR, 1e-6);
        }
    }
}

CASE(the_table_s_count_is_as_exact_as_the_twist) {
    uint64_t seed = 2;
    for (int n = 0; n < 100000; n++) {
        const axt_motion motion = random_motion(&seed);
        for (size_t i = 0; i < COUNT_OF(resolutions); i++) {
            const double twist_counts = 1e-3 / (2 * (double)PI) * resolutions[i];
            check_count(resolutions[i], &motion, AXT_ENCODER_TABLE,
                        1e-6 + 2 * REAL_EPSILON * twist_counts);
        }
    }
}

CASE(the_table_stands_behind_the_motor_by_the_twist) {
    const axt_motion motion = {.twist = (axt_real)(0.25L * 2 * PI), .turns = 3};
    int32_t motor = 0;
    int32_t table = 0;
    CHECK_EQUAL(axt_encoder_read(1000, &motion, AXT_ENCODER_MOTOR, &motor), AXT_OK);
    CHECK_EQUAL(axt_encoder_read(1000, &motion, AXT_ENCODER_TABLE, &table), AXT_OK);
    CHECK_EQUAL(motor, 3000);
    CHECK_EQUAL(table, 2750);
}

CASE(digits_beyond_the_number_type_count) {
    const axt_real half_a_count = (axt_real)(0.25 + 0x1p-25); /* above a quarter turn, exactly */
    const axt_motion below = {.fraction = half_a_count, .fraction_low = (axt_real)-0x1p-40};
    const axt_motion above = {.fraction = half_a_count, .fraction_low = (axt_real)0x1p-40};
    int32_t count = 0;
    CHECK_EQUAL(axt_encoder_read(AXT_ENCODER_COUNTS_MAX, &below, AXT_ENCODER_MOTOR, &count),
                AXT_OK);
    CHECK_EQUAL(count, AXT_ENCODER_COUNTS_MAX / 4);
    CHECK_EQUAL(axt_encoder_read(AXT_ENCODER_COUNTS_MAX, &above, AXT_ENCODER_MOTOR, &count),
                AXT_OK);
    CHECK_EQUAL(count, AXT_ENCODER_COUNTS_MAX / 4 + 1);
}

CASE(a_turn_is_as_many_counts_as_it_should_be_across_every_wrap) {
    for (size_t i = 0; i < COUNT_OF(resolutions); i++) {
        axt_motion motion = {.fraction = (axt_real)0.25};
        const int32_t starts[] = {0, -1, INT32_MAX - 2, INT32_MIN, 2147, -2148, 127, -128};
        for (size_t j = 0; j < COUNT_OF(starts); j++) {
            motion.turns = starts[j];
            int32_t last = 0;
            CHECK_EQUAL(axt_encoder_read(resolutions[i], &motion, AXT_ENCODER_MOTOR, &last),
                        AXT_OK);
            for (int n = 0; n < 10; n++) {
                motion.turns = (int32_t)((uint32_t)motion.turns + 1U);
                int32_t count = 0;
                CHECK_EQUAL(axt_encoder_read(resolutions[i], &motion, AXT_ENCODER_MOTOR, &count),
                            AXT_OK);
                CHECK_EQUAL(axt_encoder_difference(count, last), resolutions[i]);
                last = count;
            }
        }
    }
}

CASE(differences_are_right_across_the_wrap) {
    uint64_t seed = 3;
    CHECK_EQUAL(axt_encoder_difference(INT32_MIN, INT32_MAX), 1);
    CHECK_EQUAL(axt_encoder_difference(INT32_MAX, INT32_MIN), -1);
    CHECK_EQUAL(axt_encoder_difference(5, -5), 10);
    for (int n = 0; n < 100000; n++) {
        const int64_t earlier = (int32_t)(uint32_t)random_bits(&seed);
        const int64_t moved = (int32_t)(uint32_t)random_bits(&seed);
        const int32_t later = (int32_t)(uint32_t)(uint64_t)(earlier + moved);
        CHECK_EQUAL(axt_encoder_difference(later, (int32_t)earlier), moved);
    }
}

CASE(counts_are_angles) {
    uint64_t seed = 4;
    for (int n = 0; n < 100000; n++) {
        const uint32_t counts_per_turn = resolutions[(size_t)n % COUNT_OF(resolutions)];
        const int32_t count = (int32_t)(uint32_t)random_bits(&seed);
        const wide angle = 2 * PI * count / counts_per_turn;
        CHECK_NEAR((wide)axt_encoder_angle(counts_per_turn, count) / angle, 1, 4 * REAL_EPSILON);
    }
    CHECK_NEAR(axt_encoder_angle(1048576, 0), 0, 0);
}

/* 64 turns of twist are 2^30 of the finest counts. */
CASE(a_twist_of_less_than_64_turns_is_in_range) {
    const axt_real limit = 64 * (axt_real)(2 * PI);
    int32_t count = 4711;
    for (int sign = -1; sign <= 1; sign += 2) {
        const axt_motion at = {.twist = limit * (axt_real)sign};
        CHECK_EQUAL(axt_encoder_read(AXT_ENCODER_COUNTS_MAX, &at, AXT_ENCODER_TABLE, &count),
                    AXT_ERROR_RANGE);
        CHECK_EQUAL(count, 4711);
    }
    const axt_motion below = {.twist = limit * (1 - 2 * (axt_real)REAL_EPSILON)};
    CHECK_EQUAL(axt_encoder_read(AXT_ENCODER_COUNTS_MAX, &below, AXT_ENCODER_TABLE, &count),
                AXT_OK);
    CHECK_NEAR(count, -0x1p30, 0x1p30 * 4 * REAL_EPSILON + 1);
}

CASE(bad_resolutions_and_motions_are_refused_and_no_count_is_written) {
    const axt_motion fine = {.fraction = (axt_real)0.1};
    int32_t count = 4711;
    CHECK_EQUAL(axt_encoder_read(0, &fine, AXT_ENCODER_MOTOR, &count), AXT_ERROR_RANGE);
    CHECK_EQUAL(axt_encoder_read(AXT_ENCODER_COUNTS_MAX + 1, &fine, AXT_ENCODER_MOTOR, &count),
                AXT_ERROR_RANGE);
    CHECK_EQUAL(axt_encoder_read(UINT32_MAX, &fine, AXT_ENCODER_MOTOR, &count), AXT_ERROR_RANGE);
    const axt_motion far[] = {{.fraction = 1000}, {.fraction = -1000}, {.fraction = (axt_real)1e30},
                              {.twist = 1000},    {.twist = -1000},    {.twist = (axt_real)1e30}};
    for (size_t i = 0; i < COUNT_OF(far); i++) {
        CHECK_EQUAL(axt_encoder_read(AXT_ENCODER_COUNTS_MAX, &far[i], AXT_ENCODER_TABLE, &count),
                    AXT_ERROR_RANGE);
    }
    for (size_t i = 0; i < COUNT_OF(not_finite); i++) {
        const axt_motion bad[] = {
            {.fraction = not_finite[i]}, {.fraction_low = not_finite[i]}, {.twist = not_finite[i]}};
        for (size_t j = 0; j < COUNT_OF(bad); j++) {
            CHECK_EQUAL(axt_encoder_read(10000, &bad[j], AXT_ENCODER_TABLE, &count),
                        AXT_ERROR_NOT_FINITE);
        }
    }
    CHECK_EQUAL(count, 4711);
}

int main(void) {
    RUN(the_count_is_the_nearest_at_any_number_of_turns);
    RUN(the_table_s_count_is_as_exact_as_the_twist);
    RUN(the_table_stands_behind_the_motor_by_the_twist);
    RUN(digits_beyond_the_number_type_count);
    RUN(a_turn_is_as_many_counts_as_it_should_be_across_every_wrap);
    RUN(differences_are_right_across_the_wrap);
    RUN(counts_are_angles);
    RUN(a_twist_of_less_than_64_turns_is_in_range);
    RUN(bad_resolutions_and_motions_are_refused_and_no_count_is_written);
    return REPORT();
}
