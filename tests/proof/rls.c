/* One update of the recursive least squares.
 *
 * Preconditions: a filter that axt_rls_init() accepted, factors D of 1e-6 up to the prior and U up
 * to 1e3, parameters up to 1e6, a sample up to 1e3 (all are scaled to about 1); then nothing in
 * between or after is infinite or not a number. A sample with an element of 1e9 to 1e18 is refused
 * (beyond, its square is infinite and compares the same).
 *
 * Not proven: that U and the parameters stay within these bounds after any number of updates. What
 * bounds them is that P = U D U' only shrinks but for the growth of D, which intervals cannot
 * follow; tests/unit/test_rls.c, the fuzzer and the bench's survival cases test it. */
#include "any.h"
#include "axt_rls.h"

static axt_rls any_filter(uint32_t inputs, uint32_t outputs) {
    axt_rls rls;
    (void)axt_rls_init(&rls, inputs, outputs, any_float(0.9F, 1.0F), any_float(1.0F, 1e15F));
    for (uint32_t j = 0; j < inputs; j++) {
        for (uint32_t i = 0; i < j; i++) {
            rls.factor[j * (j + 1) / 2 + i] = any_float(-1e3F, 1e3F);
        }
        rls.factor[j * (j + 1) / 2 + j] = any_float(1e-6F, 1.00001e15F);
        for (uint32_t k = 0; k < outputs; k++) {
            rls.theta[k][j] = any_float(-1e6F, 1e6F);
        }
    }
    rls.rejected = Frama_C_unsigned_int_interval(0, UINT32_MAX);
    rls.restarts = Frama_C_unsigned_int_interval(0, UINT32_MAX);
    return rls;
}

static void any_floats(float *values, uint32_t count, float least, float most) {
    for (uint32_t i = 0; i < count; i++) {
        values[i] = any_float(least, most);
    }
}

static void prove_update(uint32_t inputs, uint32_t outputs) {
    float phi[AXT_RLS_INPUTS_MAX];
    float y[AXT_RLS_OUTPUTS_MAX];
    any_floats(phi, inputs, -1e3F, 1e3F);
    any_floats(y, outputs, -1e3F, 1e3F);
    axt_rls rls = any_filter(inputs, outputs);
    (void)axt_rls_update(&rls, phi, y);
    for (uint32_t j = 0; j < inputs; j++) {
        const float d = rls.factor[j * (j + 1) / 2 + j];
        //@ assert positive: d > 0;
        //@ assert largest: d <= 1.00001e15F;
    }
}

/* An element out of range, at each place of the sample. Only squares are looked at, so the others
 * may as well be positive. */
static void prove_refused(uint32_t inputs, uint32_t outputs) {
    for (uint32_t place = 0; place < inputs + outputs; place++) {
        float phi[AXT_RLS_INPUTS_MAX];
        float y[AXT_RLS_OUTPUTS_MAX];
        any_floats(phi, inputs, 0.0F, 1e18F);
        any_floats(y, outputs, 0.0F, 1e18F);
        float *const element = (place < inputs) ? &phi[place] : &y[place - inputs];
        *element = any_float(1.000001e9F, 1e18F);
        axt_rls rls = any_filter(inputs, outputs);
        const axt_status status = axt_rls_update(&rls, phi, y);
        //@ assert refused: status == AXT_ERROR_RANGE;
    }
}

int main(void) {
    prove_update(3, 2);
    prove_update(5, 4);
    prove_update(2, 1);
    prove_refused(3, 2);
    prove_refused(5, 4);
    return 0;
}
