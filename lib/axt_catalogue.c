#include "axt_catalogue.h"

#include <stddef.h>

/* Nothing but numbers of one type, so that an index finds each. */
_Static_assert(sizeof(axt_effects) % sizeof(axt_real) == 0 &&
                   sizeof(axt_effects) / sizeof(axt_real) <= 255,
               "a parameter's index fits into a byte");

#define AT(member) ((uint8_t)(offsetof(axt_effects, member) / sizeof(axt_real)))

/* Where a parameter is: of one instance, or in the first of several waves. */
#define ONE(member)  AT(member), 1, 0
#define WAVE(member) AT(member), AXT_EFFECTS_WAVES, sizeof(axt_wave) / sizeof(axt_real)

/* What is new comes last: on the bus a parameter is the number of its entry. */
static const axt_catalogue_entry entries[] = {
    {"friction_coulomb", "motor", "torque", "N m", 1, 0, ONE(friction[0].coulomb)},
    {"friction_viscous", "motor", "coefficient", "N m s/rad", 1, -1, ONE(friction[0].viscous)},
    {"friction_stribeck", "motor", "torque", "N m", 1, 0, ONE(friction[0].stribeck)},
    {"friction_stribeck", "motor", "speed", "rad/s", 0, 1, ONE(friction[0].stribeck_speed)},
    {"friction_drift", "motor", "rate", "1/s", 0, 0, ONE(friction[0].drift)},
    {"friction_coulomb", "table", "torque", "N m", 1, 0, ONE(friction[1].coulomb)},
    {"friction_viscous", "table", "coefficient", "N m s/rad", 1, -1, ONE(friction[1].viscous)},
    {"friction_stribeck", "table", "torque", "N m", 1, 0, ONE(friction[1].stribeck)},
    {"friction_stribeck", "table", "speed", "rad/s", 0, 1, ONE(friction[1].stribeck_speed)},
    {"friction_drift", "table", "rate", "1/s", 0, 0, ONE(friction[1].drift)},
    {"torque_offset", "motor", "torque", "N m", 1, 0, ONE(torque_offset[0])},
    {"disturbance", "motor", "amplitude", "N m", 1, 0, ONE(disturbance[0].amplitude)},
    {"disturbance", "motor", "frequency", "rad/s", 0, 0, ONE(disturbance[0].frequency)},
    {"disturbance", "motor", "phase", "rad", 0, 0, ONE(disturbance[0].phase)},
    {"torque_offset", "table", "torque", "N m", 1, 0, ONE(torque_offset[1])},
    {"disturbance", "table", "amplitude", "N m", 1, 0, ONE(disturbance[1].amplitude)},
    {"disturbance", "table", "frequency", "rad/s", 0, 0, ONE(disturbance[1].frequency)},
    {"disturbance", "table", "phase", "rad", 0, 0, ONE(disturbance[1].phase)},
    {"torque_ripple", "motor", "amplitude", "N m", 1, 0, WAVE(torque_ripple[0].amplitude)},
    {"torque_ripple", "motor", "periods", "1", 0, 0, WAVE(torque_ripple[0].periods)},
    {"torque_ripple", "motor", "phase", "rad", 0, 0, WAVE(torque_ripple[0].phase)},
    {"backlash", "shaft", "gap", "rad", 0, 1, ONE(backlash)},
    {"stiffness_hardening", "shaft", "coefficient", "N m/rad3", 1, -3, ONE(stiffness_hardening)},
    {"stiffness_drift", "shaft", "rate", "1/s", 0, 0, ONE(stiffness_drift)},
    {"load_change", "table", "ratio", "1", 0, 0, ONE(load_change.ratio)},
    {"load_change", "table", "time", "s", 0, 0, ONE(load_change.time)},
    {"extra_mode", "table", "frequency", "rad/s", 0, 0, ONE(extra_mode.frequency)},
    {"extra_mode", "table", "damping_ratio", "1", 0, 0, ONE(extra_mode.damping_ratio)},
    {"extra_mode", "table", "mass_ratio", "1", 0, 0, ONE(extra_mode.mass_ratio)},
    {"delay", "torque", "time", "s", 0, 0, ONE(torque_delay)},
    {"torque_saturation", "motor", "limit", "N m", 1, 0, ONE(torque_saturation)},
    {"lead_error", "table", "amplitude", "rad", 0, 1, WAVE(lead_error[0].amplitude)},
    {"lead_error", "table", "periods", "1", 0, 0, WAVE(lead_error[0].periods)},
    {"lead_error", "table", "phase", "rad", 0, 0, WAVE(lead_error[0].phase)},
    {"encoder_eccentricity", "encoder1", "amplitude", "rad", 0, 1,
     ONE(encoder_eccentricity[0].amplitude)},
    {"encoder_eccentricity", "encoder1", "phase", "rad", 0, 0, ONE(encoder_eccentricity[0].phase)},
    {"delay", "encoder1", "time", "s", 0, 0, ONE(encoder_delay[0])},
    {"quantisation", "encoder1", "counts", "1", 0, 0, ONE(quantisation[0])},
    {"encoder_eccentricity", "encoder2", "amplitude", "rad", 0, 1,
     ONE(encoder_eccentricity[1].amplitude)},
    {"encoder_eccentricity", "encoder2", "phase", "rad", 0, 0, ONE(encoder_eccentricity[1].phase)},
    {"delay", "encoder2", "time", "s", 0, 0, ONE(encoder_delay[1])},
    {"quantisation", "encoder2", "counts", "1", 0, 0, ONE(quantisation[1])},
    {"friction_asymmetry", "motor", "coefficient", "N m s/rad", 1, -1, ONE(friction[0].asymmetry)},
    {"friction_asymmetry", "table", "coefficient", "N m s/rad", 1, -1, ONE(friction[1].asymmetry)},
};

const axt_catalogue_entry *axt_catalogue(uint32_t index) {
    return (index < sizeof entries / sizeof entries[0]) ? &entries[index] : NULL;
}

static bool same(const char *a, const char *b) {
    while (*a != '\0' && *a == *b) {
        a++;
        b++;
    }
    return *a == *b;
}

const axt_catalogue_entry *axt_catalogue_find(const char *effect, const char *location,
                                              const char *parameter) {
    for (uint32_t i = 0; i < sizeof entries / sizeof entries[0]; i++) {
        if (same(entries[i].effect, effect) && same(entries[i].location, location) &&
            same(entries[i].parameter, parameter)) {
            return &entries[i];
        }
    }
    return NULL;
}

axt_status axt_catalogue_set(const axt_catalogue_entry *entry, uint32_t instance, axt_real value,
                             axt_effects *effects) {
    if (instance >= entry->instances) {
        return AXT_ERROR_RANGE;
    }
    axt_real *numbers = (axt_real *)effects;
    numbers[entry->at + instance * entry->stride] = value;
    return AXT_OK;
}
