/* Counts the instructions of every call that a drive makes in its control interrupt, one call at a
 * time: while the axis runs (a mean and a maximum), and in the worst that can happen to it (a
 * maximum). instructions.py makes the figures of it. */
#include <float.h>
#include <math.h>

#include "counter.h"
#include "drive.h"

enum { FORMS = 2, RUNNING = 2 * DRIVE_PERIOD, STANDING = DRIVE_PERIOD };

static const struct {
    axt_ident_form form;
    const char *rls;
    const char *ident_motion;
    const char *ident_counts;
} form[FORMS] = {
    {AXT_IDENT_3X2, "rls_3x2", "ident_motion_3x2", "ident_counts_3x2"},
    {AXT_IDENT_5X4, "rls_5x4", "ident_motion_5x4", "ident_counts_5x4"},
};

/* Ten turns in RUNNING samples: everything that has to be done once a turn happens. */
#define SPEED 2000.0F

/* Each is called with what the others give; all but the drive are one step of it. */
typedef struct {
    drive drive;
    drive identifying;
    axt_player excitation;
    axt_plant plant;
    axt_filter filter;
    axt_filter_state channel;
    axt_regressor regressor[FORMS];
    axt_rls rls[FORMS];
    axt_ident from_motion[FORMS];
    axt_ident from_counts[FORMS];
    axt_monitor monitor;
} subjects;

/* What the calls of one control period are given. */
typedef struct {
    axt_real torque;
    axt_motion motion;
    int32_t count[2];
    axt_equation equation[FORMS];
} sample;

static axt_real excitation[DRIVE_PERIOD];
static subjects subject;
static subjects before;

static void require(axt_status status) {
    if (status != AXT_OK) {
        counter_fail(axt_status_string(status));
    }
}

static void set_up(void) {
    drive_fill_excitation(excitation);
    require(drive_init(&subject.drive, excitation, SPEED));
    subject.identifying = subject.drive;
    subject.excitation = subject.drive.excitation;
    subject.plant = subject.drive.plant;
    subject.filter = subject.drive.ident.regressor.filter;
    axt_filter_start(&subject.channel, 0.0F);
    const axt_monitor_config monitor = {.batch = 100, .learning = 20, .false_alarm = 1e9F};
    require(axt_monitor_init(&subject.monitor, &monitor));
    for (int i = 0; i < FORMS; i++) {
        const axt_ident_config motion = drive_ident_config(form[i].form, 0.999F, false);
        const axt_ident_config counts = drive_ident_config(form[i].form, 0.999F, true);
        require(axt_regressor_init(&subject.regressor[i], &motion));
        require(axt_ident_init(&subject.from_motion[i], &motion));
        require(axt_ident_init(&subject.from_counts[i], &counts));
        subject.rls[i] = subject.from_motion[i].rls;
    }
}

/* The steps of a control period that make the sample. */
static void make_sample(sample *x) {
    COUNTED("plant_ideal", axt_plant_step(&subject.plant, x->torque));
    counter_begin();
    axt_plant_read(&subject.plant, &x->motion);
    counter_end("plant_read");
    for (int i = 0; i < 2; i++) {
        const axt_encoder_place place = (i == 0) ? AXT_ENCODER_MOTOR : AXT_ENCODER_TABLE;
        COUNTED("encoder_read", axt_encoder_read(DRIVE_COUNTS, &x->motion, place, &x->count[i]));
    }
    for (int i = 0; i < FORMS; i++) {
        (void)axt_regressor_motion(&subject.regressor[i], &x->motion, x->torque, &x->equation[i]);
    }
}

/* The steps that learn from it. */
static void use_sample(const sample *x) {
    counter_begin();
    axt_filter_step(&subject.filter, &subject.channel, x->torque);
    counter_end("filter_step");
    for (int i = 0; i < FORMS; i++) {
        axt_rls *const rls = &subject.rls[i];
        axt_ident *const motion = &subject.from_motion[i];
        axt_ident *const counts = &subject.from_counts[i];
        const axt_real *const phi = x->equation[i].phi;
        const axt_real *const y = x->equation[i].y;
        COUNTED(form[i].rls, axt_rls_update(rls, phi, y));
        COUNTED(form[i].ident_motion,
                axt_ident_motion(motion, motion->guard.next, &x->motion, x->torque));
        COUNTED(form[i].ident_counts,
                axt_ident_counts(counts, counts->guard.next, x->count[0], x->count[1], x->torque));
    }
    const axt_equation *const equation = &subject.from_counts[0].equation;
    COUNTED("monitor_step", axt_monitor_step(&subject.monitor, equation));
}

static void run(uint32_t samples) {
    sample x = {.torque = 0.0F};
    for (uint32_t n = 0; n < samples; n++) {
        counter_begin();
        counter_end("nothing");
        counter_begin();
        drive_control_tick(&subject.drive);
        counter_end("control_tick");
        counter_begin();
        drive_identifying_tick(&subject.identifying);
        counter_end("identifying_tick");
        COUNTED("excitation", x.torque = axt_player_step(&subject.excitation));
        make_sample(&x);
        use_sample(&x);
    }
}

static void learn_from_counts(void) {
    (void)axt_ident_counts(&subject.from_counts[1], subject.from_counts[1].guard.next, 0, 0, 0.0F);
}

static void learn_from_motion(void) {
    static const axt_motion rest;
    (void)axt_ident_motion(&subject.from_motion[1], subject.from_motion[1].guard.next, &rest, 0.0F);
}

static void tick(void) {
    drive_identifying_tick(&subject.identifying);
}

/* Standing still with forgetting: whatever winds up does so now. */
static void stand_still(void) {
    static const axt_real nothing[1] = {0.0F};
    const axt_motion rest = {.twist = 0.0F};
    require(axt_plant_set(&subject.plant, &rest, 0.0F));
    require(axt_plant_set(&subject.drive.plant, &rest, 0.0F));
    require(axt_plant_set(&subject.identifying.plant, &rest, 0.0F));
    require(axt_player_init(&subject.excitation, nothing, 1));
    require(axt_player_init(&subject.drive.excitation, nothing, 1));
    require(axt_player_init(&subject.identifying.excitation, nothing, 1));
    run(STANDING);
}

/* A value where it does not belong, everywhere in turn, from the same state each time. */
static void disturb(const axt_real *value) {
    const axt_real size = fabsf(*value);
    const int32_t count = (size < 2e9F) ? (int32_t)*value : INT32_MIN;
    before = subject;

    sample x = {.torque = *value};
    require(axt_player_init(&subject.drive.excitation, value, 1));
    require(axt_player_init(&subject.identifying.excitation, value, 1));
    counter_begin();
    drive_control_tick(&subject.drive);
    counter_end("control_tick");
    counter_begin();
    drive_identifying_tick(&subject.identifying);
    counter_end("identifying_tick");
    make_sample(&x);
    use_sample(&x);
    subject = before;

    axt_real *const moved[] = {&x.motion.twist,    &x.motion.twist_speed,  &x.motion.speed,
                               &x.motion.fraction, &x.motion.fraction_low, &x.torque};
    for (unsigned i = 0; i < sizeof moved / sizeof moved[0]; i++) {
        x = (sample){.count = {count, count / 2}};
        axt_plant_read(&subject.plant, &x.motion);
        *moved[i] = *value;
        for (int k = 0; k < 2; k++) {
            const axt_encoder_place place = (k == 0) ? AXT_ENCODER_MOTOR : AXT_ENCODER_TABLE;
            COUNTED("encoder_read", axt_encoder_read(DRIVE_COUNTS, &x.motion, place, &x.count[k]));
        }
        x.motion.turns = count;
        use_sample(&x);
        subject = before;
    }
    for (int i = 0; i < AXT_REGRESSOR_INPUTS_MAX; i++) {
        x = (sample){.count = {count, 0}};
        for (int k = 0; k < FORMS; k++) {
            x.equation[k].phi[i] = *value;
            x.equation[k].phi[0] = *value;
            x.equation[k].y[i % AXT_REGRESSOR_OUTPUTS_MAX] = *value;
        }
        use_sample(&x);
        subject = before;
    }
}

int main(void) {
    static const axt_real values[] = {
        0.0F, -0.0F, 1e-45F, 1e-39F, 1e-20F, -1e-6F, 1.0F,    -1.0F,    1e3F,     -1e6F,     1e6F,
        1e9F, -1e9F, 1e12F,  -1e18F, 1e30F,  -1e30F, FLT_MAX, -FLT_MAX, INFINITY, -INFINITY, NAN};
    counter_init();
    set_up();
    counter_section("starting");
    run(2 * DRIVE_PERIOD); /* until filters have settled and estimates stand */
    require(axt_monitor_start(&subject.monitor, &subject.from_counts[0]));
    counter_section("running");
    run(RUNNING);
    if (subject.drive.faults != 0 || subject.identifying.faults != 0) {
        counter_fail("the drive refused a sample of normal running");
    }
    counter_stack("axt_ident_counts", learn_from_counts);
    counter_stack("axt_ident_motion", learn_from_motion);
    counter_stack("identifying_tick", tick);
    counter_section("disturbed");
    for (unsigned i = 0; i < sizeof values / sizeof values[0]; i++) {
        disturb(&values[i]);
    }
    counter_section("standing");
    stand_still();
    for (unsigned i = 0; i < sizeof values / sizeof values[0]; i++) {
        disturb(&values[i]);
    }
    return 0;
}
