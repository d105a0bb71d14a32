/* axt_settings.h - what is set for one drive and not for all: a few words in a page of flash of
 * their own, as commissioning leaves them there. An erased or damaged page means the defaults.
 */
#ifndef AXT_SETTINGS_H
#define AXT_SETTINGS_H

#include <stdint.h>

#define AXT_SETTINGS_SIGNATURE UINT32_C(0x41585453) /* ASCII AXTS */

/* Bits of `flags`. */
enum {
    AXT_SETTINGS_EXCITED = 1,  /* operation enabled and excitation on from the start, by no host */
    AXT_SETTINGS_STREAMING = 2 /* live stream on from the start */
};

/* Little-endian words, as they stand in the page. */
typedef struct {
    uint32_t signature;
    uint32_t node;              /* 1 .. 126; the Modbus unit, too */
    uint32_t stream_decimation; /* control periods between streamed samples, 1 or more */
    uint32_t host_timeout;      /* longest time without the host's heartbeat, 1 .. 65535 [ms] */
    uint32_t flags;
    uint32_t checksum; /* CRC-32 of all before */
} axt_settings;

/* `page` if signature, checksum and values are right, the defaults otherwise. */
axt_settings axt_settings_read(const axt_settings *page);

#endif
