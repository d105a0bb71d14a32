/* axt_real.h - the number type of the library.
 *
 * `float` unless AXT_REAL says `double` (-DAXT_REAL=double). Every function works in this one type;
 * nothing is promoted behind the caller's back.
 */
#ifndef AXT_REAL_H
#define AXT_REAL_H

#include <stdbool.h>
#include <stdint.h>

#ifndef AXT_REAL
#define AXT_REAL float
#endif

typedef AXT_REAL axt_real;

#endif
