#include "drive.h"

axt_real drive_time_step(void) {
    axt_modal modal;
    return (axt_axis_modal(&axt_axis_paper, &modal) == AXT_OK)
               ? axt_time_step(DRIVE_PERIOD, DRIVE_LINE, modal.wn)
               : 0.0F;
}

void drive_fill_excitation(axt_real table[DRIVE_PERIOD]) {
    const axt_schroeder signal = {.length = DRIVE_PERIOD,
                                  .first = 1,
                                  .stride = 1,
                                  .lines = 2 * DRIVE_LINE,
                                  .rms = DRIVE_TORQUE};
    (void)axt_schroeder_fill(&signal, table, DRIVE_PERIOD);
}

axt_ident_config drive_ident_config(axt_ident_form form, axt_real forgetting, bool encoders) {
    const uint32_t counts = encoders ? DRIVE_COUNTS : 0;
    return (axt_ident_config){.form = form,
                              .time_step = drive_time_step(),
                              .forgetting = forgetting,
                              .expected = axt_axis_paper,
                              .torque = DRIVE_TORQUE,
                              .counts_per_turn = {counts, counts}};
}

axt_status drive_init(drive *d, const axt_real *table, axt_real speed) {
    const axt_ident_config config = drive_ident_config(AXT_IDENT_3X2, 0.999F, true);
    const axt_motion start = {.speed = speed};
    *d = (drive){.faults = 0};
    axt_status status = axt_player_init(&d->excitation, table, DRIVE_PERIOD);
    if (status == AXT_OK) {
        status =
            axt_plant_init(&d->plant, &axt_axis_paper, config.time_step, &axt_newmark_trapezoidal);
    }
    if (status == AXT_OK) {
        status = axt_plant_set(&d->plant, &start, 0.0F);
    }
    return (status == AXT_OK) ? axt_ident_init(&d->ident, &config) : status;
}

static uint32_t fault(axt_status status) {
    return (status == AXT_OK) ? 0U : 1U;
}

/* Excitation, the emulated axis and its two encoders; returns the torque. */
static axt_real move(drive *d) {
    const axt_real torque = axt_player_step(&d->excitation);
    axt_motion motion;
    d->faults += fault(axt_plant_step(&d->plant, torque));
    axt_plant_read(&d->plant, &motion);
    d->faults += fault(axt_encoder_read(DRIVE_COUNTS, &motion, AXT_ENCODER_MOTOR, &d->count[0]));
    d->faults += fault(axt_encoder_read(DRIVE_COUNTS, &motion, AXT_ENCODER_TABLE, &d->count[1]));
    return torque;
}

void drive_control_tick(drive *d) {
    const axt_real torque = move(d);
    axt_ident *ident = &d->ident;
    axt_status status =
        axt_regressor_counts(&ident->regressor, d->count[0], d->count[1], torque, &ident->equation);
    if (status == AXT_OK) {
        status = axt_rls_update(&ident->rls, ident->equation.phi, ident->equation.y);
    }
    d->faults += (status == AXT_ERROR_NO_DATA) ? 0U : fault(status);
}

void drive_identifying_tick(drive *d) {
    const axt_real torque = move(d);
    const axt_status status =
        axt_ident_counts(&d->ident, d->number++, d->count[0], d->count[1], torque);
    d->faults += (status == AXT_ERROR_NO_DATA) ? 0U : fault(status);
}
