/* Recursive least squares of any shape and any settings on any samples.
 *
 * The input is shape, forgetting and prior, and then samples, up to 12 of 3x2: raw bits, or 16 bits
 * each for numbers that are seldom too large. What must hold: axt_rls_invariants(), a covariance
 * that is positive, and a sample that is refused changes nothing but its counter. */
#include "axt_rls.h"
#include "raw.h"

static void expect_invariants(const axt_rls *rls) {
    expect(axt_rls_invariants(rls));
    expect(rls->certainty > 0 && rls->certainty <= 1);
    for (uint32_t i = 0; i < rls->inputs; i++) {
        expect(axt_rls_covariance(rls, i, i) > 0);
        expect(axt_rls_information(rls, i) > 0);
    }
}

static void expect_refused(const axt_rls *rls, axt_rls before) {
    if (rls->restarts == before.restarts) {
        before.rejected++;
        expect(memcmp(rls, &before, sizeof before) == 0);
        return;
    }
    expect(memcmp(rls->theta, before.theta, sizeof before.theta) == 0);
    for (uint32_t i = 0; i < rls->inputs; i++) {
        for (uint32_t j = 0; j < rls->inputs; j++) {
            expect(axt_rls_covariance(rls, i, j) == ((i == j) ? rls->prior : 0));
        }
    }
}

/* A sample of raw bits or, as those are seldom of a size that is taken, of that size. */
static bool take_sample(raw_bytes *in, bool scaled, axt_real *sample, uint32_t count) {
    if (!scaled) {
        return take(in, sample, count * sizeof *sample);
    }
    int16_t numbers[AXT_RLS_INPUTS_MAX + AXT_RLS_OUTPUTS_MAX];
    if (!take(in, numbers, count * sizeof numbers[0])) {
        return false;
    }
    for (uint32_t i = 0; i < count; i++) { /* a sign, 6 bits of exponent and 9 of fraction */
        const int number = abs((int)numbers[i]);
        const double size = ldexp((number & 511) / 256.0, (number >> 9) - 32);
        sample[i] = (axt_real)((numbers[i] < 0) ? -size : size);
    }
    return true;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    raw_bytes in = {data, size};
    const uint8_t kind = take_byte(&in);
    uint32_t inputs = 3;
    uint32_t outputs = 2;
    if ((kind & 1) != 0) {
        inputs = take_byte(&in) % (AXT_RLS_INPUTS_MAX + 2);
        outputs = take_byte(&in) % (AXT_RLS_OUTPUTS_MAX + 2);
    }
    axt_real forgetting = ((kind & 2) != 0) ? 1 : (axt_real)0.9;
    axt_real prior = (axt_real)1e9;
    if ((kind & 4) != 0) {
        forgetting = take_magnitude(&in, 0.9, 1);
        prior = take_magnitude(&in, 1, 1e15);
    } else if ((kind & 8) != 0) {
        (void)(take(&in, &forgetting, sizeof forgetting) && take(&in, &prior, sizeof prior));
    }
    axt_rls rls;
    if (axt_rls_init(&rls, inputs, outputs, forgetting, prior) != AXT_OK) {
        return 0;
    }
    expect_invariants(&rls);
    axt_real sample[AXT_RLS_INPUTS_MAX + AXT_RLS_OUTPUTS_MAX];
    while (take_sample(&in, (kind & 16) != 0, sample, inputs + outputs)) {
        const axt_rls before = rls;
        if (axt_rls_update(&rls, sample, sample + inputs) != AXT_OK) {
            expect_refused(&rls, before);
        }
        expect_invariants(&rls);
    }
    return 0;
}
