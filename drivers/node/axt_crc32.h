/* axt_crc32.h - the CRC-32 of IEEE 802.3 (as in Ethernet, zlib and PNG). */
#ifndef AXT_CRC32_H
#define AXT_CRC32_H

#include <stdint.h>

/* The checksum of what gave `crc` so far (0 at the start) followed by bytes[0 .. size - 1]. */
uint32_t axt_crc32(uint32_t crc, const uint8_t *bytes, uint32_t size);

#endif
