#include "axt_modbus.h"

#include <stdbool.h>
#include <stddef.h>

/* Bytes before the values, and where the byte count stands (figures of V1.1b3, 6.3 to 6.17). */
enum {
    READ_LENGTH = 5, /* function, address, count; the same for writing one register */
    WRITE_HEAD = 6,
    WRITE_BYTES = 5,
    READ_WRITE_HEAD = 10,
    READ_WRITE_BYTES = 9
};

static uint16_t word_at(const uint8_t *bytes) {
    return (uint16_t)(bytes[0] << 8 | bytes[1]);
}

static void put_word(uint8_t *bytes, uint16_t word) {
    bytes[0] = (uint8_t)(word >> 8);
    bytes[1] = (uint8_t)word;
}

uint16_t axt_modbus_written(const axt_modbus_request *request, uint32_t i) {
    return word_at(request->written + (size_t)2 * i);
}

static bool within(uint32_t count, uint32_t most) {
    return count >= 1 && count <= most;
}

static axt_modbus_exception parse_read(const uint8_t *pdu, uint32_t length,
                                       axt_modbus_request *request) {
    if (length != READ_LENGTH) {
        return AXT_MODBUS_ILLEGAL_VALUE;
    }
    request->read_address = word_at(pdu + 1);
    request->read_count = word_at(pdu + 3);
    return within(request->read_count, AXT_MODBUS_READ_MAX) ? AXT_MODBUS_OK
                                                            : AXT_MODBUS_ILLEGAL_VALUE;
}

static axt_modbus_exception parse_write_one(const uint8_t *pdu, uint32_t length,
                                            axt_modbus_request *request) {
    if (length != READ_LENGTH) {
        return AXT_MODBUS_ILLEGAL_VALUE;
    }
    request->write_address = word_at(pdu + 1);
    request->write_count = 1;
    request->written = pdu + 3;
    return AXT_MODBUS_OK;
}

/* Address, count, byte count and values to write from `part` on; the PDU ends with the values. */
static axt_modbus_exception parse_values(const uint8_t *part, uint32_t length, uint32_t most,
                                         axt_modbus_request *request) {
    const uint32_t count = word_at(part + 2);
    if (!within(count, most) || part[4] != 2 * count || length != WRITE_BYTES + 2 * count) {
        return AXT_MODBUS_ILLEGAL_VALUE;
    }
    request->write_address = word_at(part);
    request->write_count = (uint16_t)count;
    request->written = part + WRITE_BYTES;
    return AXT_MODBUS_OK;
}

static axt_modbus_exception parse_write(const uint8_t *pdu, uint32_t length,
                                        axt_modbus_request *request) {
    if (length < WRITE_HEAD) {
        return AXT_MODBUS_ILLEGAL_VALUE;
    }
    return parse_values(pdu + 1, length - 1, AXT_MODBUS_WRITE_MAX, request);
}

static axt_modbus_exception parse_read_write(const uint8_t *pdu, uint32_t length,
                                             axt_modbus_request *request) {
    if (length < READ_WRITE_HEAD) {
        return AXT_MODBUS_ILLEGAL_VALUE;
    }
    const axt_modbus_exception read = parse_read(pdu, READ_LENGTH, request);
    return (read == AXT_MODBUS_OK) ? parse_values(pdu + READ_LENGTH, length - READ_LENGTH,
                                                  AXT_MODBUS_READ_WRITE_MAX, request)
                                   : read;
}

axt_modbus_exception axt_modbus_parse(const uint8_t *pdu, uint32_t length,
                                      axt_modbus_request *request) {
    *request = (axt_modbus_request){.function = pdu[0]};
    switch (pdu[0]) {
    case AXT_MODBUS_READ_HOLDING:
    case AXT_MODBUS_READ_INPUT:
        return parse_read(pdu, length, request);
    case AXT_MODBUS_WRITE_ONE:
        return parse_write_one(pdu, length, request);
    case AXT_MODBUS_WRITE:
        return parse_write(pdu, length, request);
    case AXT_MODBUS_READ_WRITE:
        return parse_read_write(pdu, length, request);
    default:
        return AXT_MODBUS_ILLEGAL_FUNCTION;
    }
}

static uint32_t answer_read(const axt_modbus_request *request, const uint16_t *registers,
                            uint8_t *pdu) {
    pdu[1] = (uint8_t)(2 * request->read_count);
    for (uint32_t i = 0; i < request->read_count; i++) {
        put_word(pdu + 2 + (size_t)2 * i, registers[request->read_address + i]);
    }
    return 2 + 2 * (uint32_t)request->read_count;
}

/* Address, and the value of one register or the count of several. */
static uint32_t answer_write(const axt_modbus_request *request, uint8_t *pdu) {
    const bool one = request->function == AXT_MODBUS_WRITE_ONE;
    put_word(pdu + 1, request->write_address);
    put_word(pdu + 3, one ? axt_modbus_written(request, 0) : request->write_count);
    return READ_LENGTH;
}

uint32_t axt_modbus_answer(const axt_modbus_request *request, axt_modbus_exception exception,
                           const uint16_t *registers, uint8_t pdu[AXT_MODBUS_PDU_MAX]) {
    pdu[0] = request->function;
    if (exception != AXT_MODBUS_OK) {
        pdu[0] |= AXT_MODBUS_EXCEPTION_BIT;
        pdu[1] = (uint8_t)exception;
        return 2;
    }
    return (request->read_count > 0) ? answer_read(request, registers, pdu)
                                     : answer_write(request, pdu);
}

uint32_t axt_modbus_expected_length(const uint8_t *pdu, uint32_t length) {
    if (length < 1) {
        return 0;
    }
    switch (pdu[0]) {
    case AXT_MODBUS_READ_HOLDING:
    case AXT_MODBUS_READ_INPUT:
    case AXT_MODBUS_WRITE_ONE:
        return READ_LENGTH;
    case AXT_MODBUS_WRITE:
        return (length > WRITE_BYTES) ? WRITE_HEAD + (uint32_t)pdu[WRITE_BYTES] : 0;
    case AXT_MODBUS_READ_WRITE:
        return (length > READ_WRITE_BYTES) ? READ_WRITE_HEAD + (uint32_t)pdu[READ_WRITE_BYTES] : 0;
    default:
        return 0;
    }
}
