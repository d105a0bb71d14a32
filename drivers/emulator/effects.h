/* effects.h - the effects of the emulated axis on the command line. */
#ifndef EFFECTS_H
#define EFFECTS_H

#include <stdbool.h>
#include <stdint.h>

#include "axt_catalogue.h"

enum { AXT_EMULATOR_EFFECTS_MAX = 256 }; /* parameters that a catalogue can have */

/* Effects, and how many instances of each there are already, at its first parameter's index. */
typedef struct {
    axt_effects effects;
    uint8_t instances[AXT_EMULATOR_EFFECTS_MAX];
} axt_emulator_effects;

/* Adds EFFECT:LOCATION:PARAMETER=VALUE[,PARAMETER=VALUE...], with the names of axt_catalogue.h.
 * False when that is no such thing: one line on standard error then says why. */
bool axt_emulator_add_effect(const char *text, axt_emulator_effects *all);

#endif
