/* inlined.h - what the analyser has to see as an expression.
 *
 * Its equalities do not survive the return of a function: of |x| <= 2 it would learn nothing about
 * x. These are lib/axt_math.h's own definitions, as macros. */
#define __builtin_fabsf(x) ((x) < 0.0F ? -(x) : (x))

#include "axt_math.h"

#define axt_abs(x)       __builtin_fabsf(x)
#define axt_fma(a, b, c) ((a) * (b) + (c))
