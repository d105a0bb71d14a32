/* axt_can_pace.h - gives a virtual bus the speed of a real one.
 *
 * A vcan interface or a socket takes frames as fast as they come and leaves it to the receiver to
 * lose them. Behind this, a bus takes no more than its bit rates allow, with every frame counted at
 * its longest (all stuff bits): 135 bits for 8 bytes, so 7,400 frames a second at 1 Mbit/s; an FD
 * frame of 64 bytes takes 169 us at 1 and 5 Mbit/s, so 5,900 a second.
 */
#ifndef AXT_CAN_PACE_H
#define AXT_CAN_PACE_H

#include "axt_can.h"

/* Bit rates of a bus [bit/s], 1 or more. */
typedef struct {
    uint32_t nominal;
    uint32_t data; /* of the data phase of FD frames */
} axt_can_bit_rates;

typedef struct {
    axt_can can;
    axt_can *bus;
    axt_can_bit_rates rates;
    uint64_t credit; /* time that the bus has had and not used [ns] */
} axt_can_pace;

/* `bus` as a bus with these bit rates. Closing it closes `bus`. */
void axt_can_pace_init(axt_can_pace *pace, axt_can *bus, const axt_can_bit_rates *rates);

/* Time passes. Idle time is not saved up for longer than 10 ms, or the longest frame. */
void axt_can_pace_elapse(axt_can_pace *pace, uint64_t nanoseconds);

/* Longest time that a frame takes [ns], with stuff bits and the space after it. */
uint64_t axt_can_frame_time(const axt_can_frame *frame, const axt_can_bit_rates *rates);

#endif
