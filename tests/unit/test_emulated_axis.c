/* The axis in the place of a real one, set up by commands on the bus. */
#include "axt_emulated_axis.h"

#include <math.h>

#include "axt_catalogue.h"
#include "node_rig.h"
#include "reference.h"

enum { EFFECT_SELECT = 64, EFFECT_VALUE, EFFECTS_CLEAR };
enum { AXIS_I1 = 67, AXIS_I2, AXIS_B, AXIS_K, AXIS_RESTART };

static void set_effect(rig *r, const char *effect, const char *location, const char *parameter,
                       uint32_t instance, float value) {
    const axt_catalogue_entry *wanted = axt_catalogue_find(effect, location, parameter);
    uint32_t index = 0;
    while (axt_catalogue(index) != wanted) {
        index++;
    }
    CHECK_EQUAL(rig_tell(r, EFFECT_SELECT, index | instance << 8), AXT_NODE_DONE);
    CHECK_EQUAL(rig_tell(r, EFFECT_VALUE, bits_of(value)), AXT_NODE_DONE);
}

/* The torque that the log has from period `from` on, applied to `axis`: the positions are the
 * log's.
 */
static void check_log(const rig *r, uint32_t from, axt_emulated_axis *axis) {
    uint32_t moved = 0;
    for (uint32_t n = from; n < r->log_count; n++) {
        int32_t position[2] = {0};
        axt_emulated_axis_apply_torque(axis, r->log[n].torque);
        axt_emulated_axis_read_encoders(axis, position);
        CHECK_EQUAL(r->log[n].position[0], position[0]);
        CHECK_EQUAL(r->log[n].position[1], position[1]);
        moved += (position[0] != 0) ? 1 : 0;
    }
    CHECK(moved > 100);
}

/* From its restart on, at rest at angle 0, the axis is the one that was set up; not before. */
CASE(the_axis_begins_anew_as_the_commands_have_set_it) {
    static const axt_axis axis = {(axt_real)3e-5F, (axt_real)2e-5F, (axt_real)4e-3F, 90};
    static const axt_effects effects = {
        .friction = {{0}, {.coulomb = (axt_real)0.02F}},
        .torque_ripple = {{.amplitude = (axt_real)0.01F, .periods = 72},
                          {.amplitude = (axt_real)0.005F, .periods = 1, .phase = (axt_real)0.5F}},
        .backlash = (axt_real)1e-3F,
    };
    rig *r = rig_running();
    rig_enable(r);
    rig_control(r, AXT_CONTRACT_CONTROL_CONTROL_WORD_ENABLE_OPERATION_CHOICE, 500);
    rig_run(r, 200);
    rig_control(r, AXT_CONTRACT_CONTROL_CONTROL_WORD_DISABLE_VOLTAGE_CHOICE, 0);

    CHECK_EQUAL(rig_tell(r, AXIS_I1, bits_of(3e-5F)), AXT_NODE_DONE);
    CHECK_EQUAL(rig_tell(r, AXIS_I2, bits_of(2e-5F)), AXT_NODE_DONE);
    CHECK_EQUAL(rig_tell(r, AXIS_B, bits_of(4e-3F)), AXT_NODE_DONE);
    CHECK_EQUAL(rig_tell(r, AXIS_K, bits_of(90)), AXT_NODE_DONE);
    set_effect(r, "friction_coulomb", "table", "torque", 0, 0.02F);
    set_effect(r, "torque_ripple", "motor", "amplitude", 0, 0.01F);
    set_effect(r, "torque_ripple", "motor", "periods", 0, 72);
    set_effect(r, "torque_ripple", "motor", "amplitude", 1, 0.005F);
    set_effect(r, "torque_ripple", "motor", "periods", 1, 1);
    set_effect(r, "torque_ripple", "motor", "phase", 1, 0.5F);
    set_effect(r, "backlash", "shaft", "gap", 0, 1e-3F);

    /* nothing of it acts yet */
    axt_emulated_axis before;
    CHECK_EQUAL(axt_emulated_axis_init(&before, &axt_axis_paper, (axt_real)rig_period,
                                       r->config.counts_per_turn),
                AXT_OK);
    check_log(r, 0, &before);

    CHECK_EQUAL(rig_tell(r, AXIS_RESTART, 0), AXT_NODE_DONE);
    const uint32_t from = r->log_count - r->axis.machine.steps;
    rig_enable(r);
    rig_control(r, AXT_CONTRACT_CONTROL_CONTROL_WORD_ENABLE_OPERATION_CHOICE, 800);
    rig_run(r, 3000);
    rig_control(r, AXT_CONTRACT_CONTROL_CONTROL_WORD_ENABLE_OPERATION_CHOICE, -800);
    rig_run(r, 3000);
    axt_emulated_axis after;
    CHECK_EQUAL(
        axt_emulated_axis_init(&after, &axis, (axt_real)rig_period, r->config.counts_per_turn),
        AXT_OK);
    CHECK_EQUAL(axt_emulated_axis_set_effects(&after, &effects), AXT_OK);
    check_log(r, from, &after);
    free(r);
}

/* Every parameter of every instance is set by its index and nothing else is, and one behind the
 * last of each is refused. */
CASE(each_parameter_has_its_place) {
    rig *r = rig_running();
    const size_t numbers = sizeof(axt_effects) / sizeof(axt_real);
    uint32_t places = 0;
    uint32_t index = 0;
    for (const axt_catalogue_entry *entry; (entry = axt_catalogue(index)) != NULL; index++) {
        for (uint32_t instance = 0; instance < entry->instances; instance++) {
            CHECK_EQUAL(rig_tell(r, EFFECTS_CLEAR, 0), AXT_NODE_DONE);
            CHECK_EQUAL(rig_tell(r, EFFECT_SELECT, index | instance << 8), AXT_NODE_DONE);
            CHECK_EQUAL(rig_tell(r, EFFECT_VALUE, bits_of(3)), AXT_NODE_DONE);
            const axt_real *found = (const axt_real *)&r->axis.next_effects;
            for (size_t i = 0; i < numbers; i++) {
                const bool here = i == entry->at + instance * (size_t)entry->stride;
                CHECK_EQUAL((int)found[i], here ? 3 : 0);
            }
            places++;
        }
        CHECK_EQUAL(rig_tell(r, EFFECT_SELECT, index | (uint32_t)entry->instances << 8),
                    AXT_NODE_OUT_OF_RANGE);
    }
    CHECK_EQUAL(places, numbers); /* none is left out */
    CHECK_EQUAL(rig_tell(r, EFFECT_SELECT, index), AXT_NODE_OUT_OF_RANGE);
    CHECK_EQUAL(rig_tell(r, EFFECT_SELECT, UINT32_MAX), AXT_NODE_OUT_OF_RANGE);
    free(r);
}

CASE(no_axis_begins_that_there_cannot_be) {
    rig *r = rig_running();
    rig_enable(r);
    rig_control(r, AXT_CONTRACT_CONTROL_CONTROL_WORD_ENABLE_OPERATION_CHOICE, 500);
    rig_run(r, 200);
    const int32_t gone = r->log[r->log_count - 1].position[0];
    CHECK(gone > 0);
    CHECK_EQUAL(rig_tell(r, AXIS_RESTART, 0), AXT_NODE_NOT_WHILE_ENABLED);
    rig_control(r, AXT_CONTRACT_CONTROL_CONTROL_WORD_DISABLE_VOLTAGE_CHOICE, 0);

    static const float wrong[] = {-1, 0, NAN, INFINITY};
    for (size_t i = 0; i < COUNT_OF(wrong); i++) {
        CHECK_EQUAL(rig_tell(r, AXIS_K, bits_of(wrong[i])), AXT_NODE_DONE);
        CHECK_EQUAL(rig_tell(r, AXIS_RESTART, 0), AXT_NODE_OUT_OF_RANGE);
    }
    CHECK_EQUAL(rig_tell(r, AXIS_K, bits_of(110)), AXT_NODE_DONE);
    set_effect(r, "friction_coulomb", "motor", "torque", 0, -1);
    CHECK_EQUAL(rig_tell(r, AXIS_RESTART, 0), AXT_NODE_OUT_OF_RANGE);
    CHECK(r->log[r->log_count - 1].position[0] >= gone); /* on it goes */
    set_effect(r, "friction_coulomb", "motor", "torque", 0, 0);
    CHECK_EQUAL(rig_tell(r, AXIS_RESTART, 0), AXT_NODE_DONE);
    CHECK_EQUAL(r->log[r->log_count - 1].position[0], 0);
    free(r);
}

CASE(a_real_axis_is_as_it_is) {
    rig *r = rig_running();
    r->node.port.axis_command = NULL;
    r->node.port.restart_axis = NULL;
    for (int code = EFFECT_SELECT; code <= AXIS_RESTART; code++) {
        CHECK_EQUAL(rig_tell(r, (uint8_t)code, 0), AXT_NODE_UNKNOWN_COMMAND);
    }
    free(r);
}

int main(void) {
    RUN(the_axis_begins_anew_as_the_commands_have_set_it);
    RUN(each_parameter_has_its_place);
    RUN(no_axis_begins_that_there_cannot_be);
    RUN(a_real_axis_is_as_it_is);
    return REPORT();
}
