/* axt_modbus.h - requests of the Modbus application protocol (V1.1b3), seen from a server.
 *
 * Portable: bytes in, what they ask for out, and back. A protocol data unit (PDU) is a function and
 * its data, without the address and checksum of a serial line or the header of TCP. No byte is
 * trusted: lengths and counts are checked before anything else is looked at.
 */
#ifndef AXT_MODBUS_H
#define AXT_MODBUS_H

#include <stdint.h>

enum {
    AXT_MODBUS_PDU_MAX = 253,
    AXT_MODBUS_READ_MAX = 125,      /* registers */
    AXT_MODBUS_WRITE_MAX = 123,     /* registers, by function 16 */
    AXT_MODBUS_READ_WRITE_MAX = 121 /* registers written by function 23 */
};

enum {
    AXT_MODBUS_READ_HOLDING = 3,
    AXT_MODBUS_READ_INPUT = 4,
    AXT_MODBUS_WRITE_ONE = 6,
    AXT_MODBUS_WRITE = 16,
    AXT_MODBUS_READ_WRITE = 23,
    AXT_MODBUS_EXCEPTION_BIT = 0x80 /* set in the function of an answer that is an exception */
};

/* Zero is fine, anything else the exception code to answer with. */
typedef enum {
    AXT_MODBUS_OK = 0,
    AXT_MODBUS_ILLEGAL_FUNCTION = 1,
    AXT_MODBUS_ILLEGAL_ADDRESS = 2,
    AXT_MODBUS_ILLEGAL_VALUE = 3,
    AXT_MODBUS_REFUSED = 4, /* the protocol's "server device failure" */
    AXT_MODBUS_BUSY = 6,
    AXT_MODBUS_NO_TARGET = 11 /* there is no unit of that id */
} axt_modbus_exception;

/* What a request asks for: first to write, then to read. A count of 0: nothing of that. */
typedef struct {
    uint8_t function;
    uint16_t write_address;
    uint16_t write_count;
    const uint8_t *written; /* two bytes a register, in the bytes that were parsed */
    uint16_t read_address;
    uint16_t read_count;
} axt_modbus_request;

/* Understands pdu[0 .. length - 1], of length 1 or more. `request->function` is set in any case,
 * the rest only with AXT_MODBUS_OK. Fails with _ILLEGAL_FUNCTION, and with _ILLEGAL_VALUE when the
 * length or a count is not what the function allows. */
axt_modbus_exception axt_modbus_parse(const uint8_t *pdu, uint32_t length,
                                      axt_modbus_request *request);

/* Register i of those to be written, i < write_count. */
uint16_t axt_modbus_written(const axt_modbus_request *request, uint32_t i);

/* Writes the answer to a request and returns its length, 2 .. AXT_MODBUS_PDU_MAX: an exception, or
 * with AXT_MODBUS_OK what was asked for. `registers`, by address, are looked at where some are to
 * be read. */
uint32_t axt_modbus_answer(const axt_modbus_request *request, axt_modbus_exception exception,
                           const uint16_t *registers, uint8_t pdu[AXT_MODBUS_PDU_MAX]);

/* Length of the request that begins with these bytes, as far as they tell; 0 when they do not yet,
 * or have a function that is not served. For a carrier that does not say where a request ends. */
uint32_t axt_modbus_expected_length(const uint8_t *pdu, uint32_t length);

#endif
