#include "axt_settings.h"

#include <stdbool.h>
#include <stddef.h>

#include "axt_crc32.h"
#include "axt_node.h"

static const axt_settings defaults = {.node = 1, .stream_decimation = 10, .host_timeout = 400};

static bool is_valid(const axt_settings *page) {
    const uint32_t size = offsetof(axt_settings, checksum);
    return page->signature == AXT_SETTINGS_SIGNATURE &&
           page->checksum == axt_crc32(0, (const uint8_t *)page, size) && page->node >= 1 &&
           page->node <= AXT_NODE_ID_MAX && page->stream_decimation >= 1 &&
           page->host_timeout >= 1 && page->host_timeout <= UINT16_MAX;
}

axt_settings axt_settings_read(const axt_settings *page) {
    return is_valid(page) ? *page : defaults;
}
