/* drive_example.c - runs the C example of README.md, which is compiled beside it, as a drive would:
 * the paper's axis under Schroeder excitation that is held over each control period, at whose start
 * the encoders are read. The example passes when it comes to know the axis. */
#include "axt.h"

#include <math.h>
#include <stdio.h>

axt_status identifier_start(void);
void identifier_step(uint32_t period, int32_t motor, int32_t table, float torque);
bool identifier_read(axt_estimate *now);

enum { PERIOD = 2048, PERIODS = 20, COUNTS = 1048576 };

/* Twice the resonance, 662 Hz, is line 135 of a period of 2048 samples of 50 us. */
static const axt_schroeder signal = {
    .length = PERIOD, .first = 1, .stride = 1, .lines = 135, .rms = 0.2f};

static float excitation[PERIOD];

static bool run(axt_integrator *axis) {
    for (uint32_t i = 0; i < PERIODS * PERIOD; i++) {
        const float torque = excitation[i % PERIOD];
        axt_motion motion;
        int32_t motor = 0;
        int32_t table = 0;
        if (axt_integrator_step(axis, torque) != AXT_OK) {
            return false;
        }
        axt_integrator_read(axis, &motion);
        if (axt_encoder_read(COUNTS, &motion, AXT_ENCODER_MOTOR, &motor) != AXT_OK ||
            axt_encoder_read(COUNTS, &motion, AXT_ENCODER_TABLE, &table) != AXT_OK) {
            return false;
        }
        identifier_step(i, motor, table, torque);
    }
    return true;
}

static bool near(const char *name, float found, float real, float tolerance) {
    printf("%-2s real %.4g, identified %.4g\n", name, (double)real, (double)found);
    return fabsf(found - real) <= tolerance * real;
}

int main(void) {
    const axt_axis *real = &axt_axis_paper;
    axt_integrator axis;
    axt_estimate found;
    bool fine = axt_schroeder_fill(&signal, excitation, PERIOD) == AXT_OK &&
                axt_integrator_init(&axis, AXT_METHOD_EXACT_HELD, real, 50e-6f) == AXT_OK &&
                identifier_start() == AXT_OK && run(&axis);
    if (!fine || !identifier_read(&found)) {
        puts("the example of README.md does not identify the axis");
        return 1;
    }
    fine = near("I1", found.axis.I1, real->I1, 0.005f);
    fine = near("I2", found.axis.I2, real->I2, 0.005f) && fine;
    fine = near("B", found.axis.B, real->B, 0.05f) && fine;
    fine = near("K", found.axis.K, real->K, 0.005f) && fine;
    return fine ? 0 : 1;
}
