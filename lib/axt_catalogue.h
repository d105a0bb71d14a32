/* axt_catalogue.h - the public names of the effects and of their parameters.
 *
 * The one list of them: the emulator's options, model files, the diagnosis and the host read it.
 */
#ifndef AXT_CATALOGUE_H
#define AXT_CATALOGUE_H

#include "axt_effects.h"
#include "axt_real.h"
#include "axt_status.h"

/* One parameter of one effect at one place. The unit is N^force rad^angle times a power of s; what
 * is a force and what is an angle decides how a linear axis reads it (N for N m, m for rad). */
typedef struct {
    const char *effect;    /* such as friction_coulomb */
    const char *location;  /* motor, table, shaft, torque, encoder1, encoder2 */
    const char *parameter; /* such as torque */
    const char *unit;      /* of a rotary axis */
    int8_t force;          /* exponents of the unit */
    int8_t angle;
    uint8_t at;        /* index in axt_effects, seen as an array of axt_real */
    uint8_t instances; /* how many an axis can have at this place */
    uint8_t stride;    /* from one instance to the next */
} axt_catalogue_entry;

/* Entry `index`, the parameters of one effect at one place next to each other; NULL behind the
 * last.
 */
const axt_catalogue_entry *axt_catalogue(uint32_t index);

/* The entry of these names, NULL when there is none. */
const axt_catalogue_entry *axt_catalogue_find(const char *effect, const char *location,
                                              const char *parameter);

/* Sets a parameter of one instance. AXT_ERROR_RANGE when there are not that many; the value itself
 * is for axt_effects_check() to judge. */
axt_status axt_catalogue_set(const axt_catalogue_entry *entry, uint32_t instance, axt_real value,
                             axt_effects *effects);

#endif
