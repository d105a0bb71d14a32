/* axt_node_frames.h - what the node says, as frames of the wire contract. Private to the node. */
#ifndef AXT_NODE_FRAMES_H
#define AXT_NODE_FRAMES_H

#include "axt_can.h"
#include "axt_contract.h"
#include "axt_node.h"

/* Report pages as a set: bit = page. */
#define AXT_NODE_PAGE(page)      (UINT64_C(1) << (page))
#define AXT_NODE_PAGE_DECIMATION AXT_NODE_PAGE(AXT_CONTRACT_REPORT_PAGE_STREAM_DECIMATION_CHOICE)
#define AXT_NODE_PAGES_IDENTITY  UINT64_C(0x3FFF)             /* 0 to 13 */
#define AXT_NODE_PAGES_TRACE     UINT64_C(0x1F00)             /* 8 to 12 */
#define AXT_NODE_PAGES_STATUS    UINT64_C(0xC000)             /* 14 and 15 */
#define AXT_NODE_PAGES_COUNTERS  UINT64_C(0xFFFFC000)         /* 14 to 31 */
#define AXT_NODE_PAGES_ESTIMATE  UINT64_C(0xFFFFF00000000)    /* 32 to 51 */
#define AXT_NODE_PAGES_SURPLUS   UINT64_C(0x3C00000000000)    /* 46 to 49, a part of these */
#define AXT_NODE_PAGES_DRIFT     UINT64_C(0xC000000000000)    /* 50 and 51, likewise */
#define AXT_NODE_PAGES_LIMITS    UINT64_C(0x1F00000000000000) /* 56 to 60 */

/* Live stream: motor and table half of a sample. */
void axt_node_frame_motor(const axt_node *node, const axt_node_stream_sample *sample,
                          axt_can_frame *frame);
void axt_node_frame_table(const axt_node *node, const axt_node_stream_sample *sample,
                          axt_can_frame *frame);

/* The six samples from place `tail` of the ring on, which belong together. */
void axt_node_frame_samples(const axt_node *node, uint32_t tail, axt_can_frame *frame);

/* Frame `number` of the captured trace: 2 x index + channel. */
void axt_node_frame_trace(const axt_node *node, uint32_t number, axt_can_frame *frame);

void axt_node_frame_heartbeat(const axt_node *node, uint8_t state, axt_can_frame *frame);

void axt_node_frame_emergency(const axt_node *node, uint16_t error_code, int32_t cause,
                              axt_can_frame *frame);

/* Report page 0 to 60 with its present value. */
void axt_node_frame_report(const axt_node *node, uint8_t page, axt_can_frame *frame);

/* Report page 254: why `control`, packed as for the tick, is not followed. */
void axt_node_frame_refusal(const axt_node *node, uint32_t control, axt_node_result result,
                            axt_can_frame *frame);

/* Report page 255: how `command` ended. */
void axt_node_frame_answer(const axt_node *node, const axt_can_frame *command,
                           axt_node_result result, axt_can_frame *frame);

/* ---- Offered to it by axt_node.c ---- */

/* Samples of the trace captured so far. */
uint32_t axt_node_captured(const axt_node *node);

/* Is a whole trace there, with its checksum? */
bool axt_node_trace_complete(const axt_node *node);

#endif
