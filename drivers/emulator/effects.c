#include "effects.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { TEXT_MAX = 256 };

static bool complain(const char *text, const char *what) {
    (void)fprintf(stderr, "axistwin-emulator: --effect %s: %s\n", text, what);
    return false;
}

/* Where in the catalogue an effect at a location begins; its end when there is none. */
static uint32_t first_of(const char *effect, const char *location) {
    uint32_t index = 0;
    for (const axt_catalogue_entry *entry; (entry = axt_catalogue(index)) != NULL; index++) {
        if (strcmp(entry->effect, effect) == 0 && strcmp(entry->location, location) == 0) {
            break;
        }
    }
    return index;
}

/* PARAMETER=VALUE. */
static bool set_parameter(const char *text, const char *effect, const char *location,
                          char *assignment, uint32_t instance, axt_effects *effects) {
    char *value = strchr(assignment, '=');
    if (value == NULL) {
        return complain(text, "wants PARAMETER=VALUE after the location");
    }
    *value++ = '\0';
    const axt_catalogue_entry *entry = axt_catalogue_find(effect, location, assignment);
    if (entry == NULL) {
        return complain(text, "this effect has no such parameter");
    }
    char *end;
    const double number = strtod(value, &end);
    if (end == value || *end != '\0' || !isfinite(number)) {
        return complain(text, "the value is no number");
    }
    if (axt_catalogue_set(entry, instance, (axt_real)number, effects) != AXT_OK) {
        return complain(text, "an axis cannot have this effect as often as that");
    }
    return true;
}

bool axt_emulator_add_effect(const char *text, axt_emulator_effects *all) {
    char copy[TEXT_MAX];
    if (strlen(text) >= sizeof copy) {
        return complain(text, "too long");
    }
    memcpy(copy, text, strlen(text) + 1);
    char *rest = copy;
    const char *effect = strsep(&rest, ":");
    const char *location = strsep(&rest, ":");
    if (location == NULL || rest == NULL) {
        return complain(text, "wants EFFECT:LOCATION:PARAMETER=VALUE[,PARAMETER=VALUE...]");
    }
    const uint32_t first = first_of(effect, location);
    if (axt_catalogue(first) == NULL) {
        return complain(text, "no such effect at this location");
    }
    const uint32_t instance = all->instances[first]++;
    while (rest != NULL) {
        char *assignment = strsep(&rest, ",");
        if (!set_parameter(text, effect, location, assignment, instance, &all->effects)) {
            return false;
        }
    }
    return true;
}
