#include "axt_record.h"

#include <stddef.h>
#include <string.h>

#include "axt_crc32.h"

/* Memory that happens to be all zero is no record. */
static uint32_t checksum(const axt_record *record) {
    const uint32_t begin = UINT32_C(0x41585452);
    return axt_crc32(begin, (const uint8_t *)record, offsetof(axt_record, checksum));
}

void axt_record_begin(axt_record *record) {
    if (record->checksum == checksum(record)) {
        record->restarts++;
    } else {
        memset(record, 0, sizeof *record);
    }
    record->checksum = checksum(record);
}

axt_fault axt_record_take_fault(axt_record *record) {
    const axt_fault fault = record->fault;
    memset(&record->fault, 0, sizeof record->fault);
    record->checksum = checksum(record);
    return fault;
}

void axt_record_keep_fault(axt_record *record, const axt_fault *fault) {
    record->fault = *fault;
    record->checksum = checksum(record);
}

void axt_record_keep_adapter(axt_record *record, const axt_slcan *slcan) {
    axt_adapter *kept = &record->adapter;
    if (kept->channel == slcan->channel && kept->timestamps == slcan->timestamps &&
        kept->acceptance_code == slcan->acceptance_code &&
        kept->acceptance_mask == slcan->acceptance_mask) {
        return;
    }
    kept->channel = slcan->channel;
    kept->timestamps = slcan->timestamps;
    kept->acceptance_code = slcan->acceptance_code;
    kept->acceptance_mask = slcan->acceptance_mask;
    record->checksum = checksum(record);
}

void axt_record_restore_adapter(const axt_record *record, axt_slcan *slcan) {
    const axt_adapter *kept = &record->adapter;
    if (record->restarts > 0) { /* else: an adapter just plugged in */
        slcan->channel = kept->channel;
        slcan->timestamps = kept->timestamps;
        slcan->acceptance_code = kept->acceptance_code;
        slcan->acceptance_mask = kept->acceptance_mask;
    }
}
