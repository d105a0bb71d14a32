/* axt_math.h - the few mathematical functions the library needs, in its own number type.
 *
 * Private to lib/. The library is freestanding: instead of <math.h> it declares the C library's
 * functions it calls, and these are all of them: sqrt, sin, cos, exp (sqrtf, sinf, cosf, expf in
 * float) and, only where the target has the instruction, fma. Everything else is arithmetic.
 */
#ifndef AXT_MATH_H
#define AXT_MATH_H

#include "axt_real.h"

#define AXT_JOIN_(a, b)    a##b
#define AXT_JOIN(a, b)     AXT_JOIN_(a, b)
#define AXT_SIZE_OF_float  4
#define AXT_SIZE_OF_double 8
#define AXT_IS_DOUBLE      (AXT_JOIN(AXT_SIZE_OF_, AXT_REAL) == 8)

/* A constant in the library's number type. */
#define AXT_R(x) ((axt_real)(x))

#define AXT_TWO_PI AXT_R(6.283185307179586476925)
#define AXT_PI     AXT_R(3.141592653589793238463)

#if AXT_IS_DOUBLE
double sqrt(double x);
double sin(double x);
double cos(double x);
double exp(double x);
#define axt_sqrt       sqrt
#define axt_sin        sin
#define axt_cos        cos
#define axt_exp        exp
#define AXT_EPSILON    AXT_R(2.220446049250313e-16)
#define AXT_REAL_MAX   AXT_R(1.7976931348623157e308)
#define AXT_SPLIT      AXT_R(134217729.0) /* 2^27 + 1, Dekker's constant */
#define AXT_FMA_NATIVE __builtin_fma
#else
float sqrtf(float x);
float sinf(float x);
float cosf(float x);
float expf(float x);
#define axt_sqrt       sqrtf
#define axt_sin        sinf
#define axt_cos        cosf
#define axt_exp        expf
#define AXT_EPSILON    AXT_R(1.1920929e-7)
#define AXT_REAL_MAX   AXT_R(3.4028234663852886e38)
#define AXT_SPLIT      AXT_R(4097.0) /* 2^12 + 1, Dekker's constant */
#define AXT_FMA_NATIVE __builtin_fmaf
#endif

/* Does the target multiply and add in one instruction? Contraction by the compiler is switched off
 * (-ffp-contract=off), so a sum is fused where, and only where, axt_fma() says so: two builds that
 * agree on AXT_FUSED agree bit for bit. */
#ifndef AXT_FUSED
#if AXT_IS_DOUBLE
#if defined(__FMA__) || (defined(__ARM_FEATURE_FMA) && defined(__ARM_FP) && (__ARM_FP & 8))
#define AXT_FUSED 1
#endif
#else
#if defined(__FMA__) || (defined(__ARM_FEATURE_FMA) && defined(__ARM_FP) && (__ARM_FP & 4))
#define AXT_FUSED 1
#endif
#endif
#ifndef AXT_FUSED
#define AXT_FUSED 0
#endif
#endif

/* a * b + c, fused where the target does so in one instruction. */
static inline axt_real axt_fma(axt_real a, axt_real b, axt_real c) {
#if AXT_FUSED
    return AXT_FMA_NATIVE(a, b, c);
#else
    return a * b + c;
#endif
}

/* One instruction where there is a floating-point unit; a comparison and a negation would be five.
 */
static inline axt_real axt_abs(axt_real x) {
#if AXT_IS_DOUBLE
    return __builtin_fabs(x);
#else
    return __builtin_fabsf(x);
#endif
}

/* False for infinities and for not-a-number: their difference with themselves is not zero. */
static inline bool axt_finite(axt_real x) {
    return axt_abs(x) <= AXT_REAL_MAX;
}

/* The power of two next below x > 0, from 1e-30 to 1e30. */
static inline axt_real axt_power_of_two(axt_real x) {
    axt_real power = AXT_R(1);
    while (power > x && power > AXT_R(1e-30)) {
        power *= AXT_R(0.5);
    }
    while (power <= AXT_R(0.5) * x && power < AXT_R(1e30)) {
        power *= AXT_R(2);
    }
    return power;
}

/* For short loops over arrays of a size known at compile time: unrolled, with constants for what
 * depends on it, they keep the arrays in registers. */
#define AXT_UNROLL   _Pragma("GCC unroll 5")
#define AXT_UNROLLED static inline __attribute__((always_inline))

/* For the branches of a dispatcher: each saves only the registers it needs itself. */
#define AXT_SEPARATE static __attribute__((noinline))

/* For what is called seldom: small before fast. */
#define AXT_COLD __attribute__((cold))

/* a + b on a register that wraps around at 32 bits, as an encoder's does. */
static inline int32_t axt_wrap_add(int32_t a, int32_t b) {
    return (int32_t)((uint32_t)a + (uint32_t)b);
}

/* later - earlier on such a register. */
static inline int32_t axt_wrap_sub(int32_t later, int32_t earlier) {
    return (int32_t)((uint32_t)later - (uint32_t)earlier);
}

/* One more on a counter that stops at its end. */
static inline void axt_count(uint32_t *counter) {
    *counter += (*counter < UINT32_MAX) ? 1U : 0U;
}

/* An unevaluated sum hi + lo with |lo| <= half a unit in the last place of hi: twice the digits. */
typedef struct {
    axt_real hi;
    axt_real lo;
} axt_two;

/* a + b without error (Knuth's two-sum): 6 additions. */
static inline axt_two axt_two_sum(axt_real a, axt_real b) {
    const axt_real hi = a + b;
    const axt_real from_b = hi - a;
    const axt_real lo = (a - (hi - from_b)) + (b - from_b);
    return (axt_two){hi, lo};
}

/* a * b without error: one fused operation, or Dekker's splitting where the target has none. */
static inline axt_two axt_two_product(axt_real a, axt_real b) {
    const axt_real hi = a * b;
#if AXT_FUSED
    return (axt_two){hi, AXT_FMA_NATIVE(a, b, -hi)};
#else
    const axt_real ca = AXT_SPLIT * a;
    const axt_real cb = AXT_SPLIT * b;
    const axt_real a_high = ca - (ca - a);
    const axt_real b_high = cb - (cb - b);
    const axt_real a_low = a - a_high;
    const axt_real b_low = b - b_high;
    const axt_real lo = ((a_high * b_high - hi) + a_high * b_low + a_low * b_high) + a_low * b_low;
    return (axt_two){hi, lo};
#endif
}

#endif
