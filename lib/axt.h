/* axt.h - AxisTwin: a digital twin of a servo axis that fits inside the drive. Includes everything.
 */
#ifndef AXT_H
#define AXT_H

#include "axt_axis.h"
#include "axt_catalogue.h"
#include "axt_effects.h"
#include "axt_els.h"
#include "axt_encoder.h"
#include "axt_excitation.h"
#include "axt_filter.h"
#include "axt_friction.h"
#include "axt_ident.h"
#include "axt_integrator.h"
#include "axt_iv.h"
#include "axt_machine.h"
#include "axt_monitor.h"
#include "axt_plant.h"
#include "axt_regressor.h"
#include "axt_rls.h"
#include "axt_rows.h"
#include "axt_scatter.h"
#include "axt_shaft.h"
#include "axt_status.h"
#include "axt_torque.h"

#endif
