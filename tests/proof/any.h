/* any.h - values that the analyser takes to be any of a range, or any bits at all. */
#ifndef AXT_PROOF_ANY_H
#define AXT_PROOF_ANY_H

#include <stddef.h>

#include "__fc_builtin.h"

/* Any bits in a variable. */
#define ANY(variable) Frama_C_make_unknown((char *)&(variable), sizeof(variable))

static inline size_t any_size(size_t least, size_t most) {
    return Frama_C_size_t_interval(least, most);
}

static inline float any_float(float least, float most) {
    return Frama_C_float_interval(least, most);
}

#endif
