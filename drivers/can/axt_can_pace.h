/* axt_can_pace.h - gives a virtual bus the speed of a real one.
 *
 * A vcan interface or a socket takes frames as fast as they come and leaves it to the receiver to
 * lose them. Behind this, a bus takes no more than its bit rate allows, with every frame counted at
 * its longest (all stuff bits): 135 bits for 8 bytes, so 7,400 frames a second at 1 Mbit/s.
 */
#ifndef AXT_CAN_PACE_H
#define AXT_CAN_PACE_H

#include "axt_can.h"

typedef struct {
    axt_can can;
    axt_can *bus;
    uint32_t bit_rate; /* [bit/s] */
    uint64_t credit;   /* bits the bus has carried time for, in 1e-9 bit */
} axt_can_pace;

/* `bus` as a bus of `bit_rate` [bit/s], 1 or more. Closing it closes `bus`. */
void axt_can_pace_init(axt_can_pace *pace, axt_can *bus, uint32_t bit_rate);

/* Time passes. Idle time is not saved up for longer than 10 ms. */
void axt_can_pace_elapse(axt_can_pace *pace, uint64_t nanoseconds);

/* Longest length of a frame on the bus [bit], with stuff bits and the space after it. */
uint32_t axt_can_frame_bits(const axt_can_frame *frame);

#endif
