#include "axt_response_loops.h"

axt_status axt_loop_respond(axt_real damping, axt_real stiffness, axt_real time_step,
                            const axt_real *first, const axt_real *last, const axt_real *start,
                            size_t windows, size_t length, axt_real *position, axt_real *speed) {
    axt_exact_map map;
    const axt_status status = axt_exact_map_init(&map, damping, stiffness, time_step);
    for (size_t w = 0; w < windows && status == AXT_OK; w++) {
        axt_real x = start[2 * w];
        axt_real v = start[2 * w + 1];
        for (size_t i = w * length; i < (w + 1) * length; i++) {
            position[i] = x;
            speed[i] = v;
            const axt_real ramp = last[i] - first[i];
            const axt_real moved =
                map.a[0][0] * x + map.a[0][1] * v + map.held[0] * first[i] + map.ramp[0] * ramp;
            v += map.a[1][0] * x + map.a[1][1] * v + map.held[1] * first[i] + map.ramp[1] * ramp;
            x += moved;
        }
    }
    return status;
}
