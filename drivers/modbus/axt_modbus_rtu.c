#include "axt_modbus_rtu.h"

void axt_modbus_rtu_init(axt_modbus_rtu *rtu, const axt_registers_port *port, uint8_t unit,
                         uint32_t bit_rate, bool eager) {
    *rtu = (axt_modbus_rtu){.port = *port, .unit = unit};
    axt_modbus_line_init(&rtu->line, bit_rate, eager);
}

void axt_modbus_rtu_receive(axt_modbus_rtu *rtu, uint8_t byte, uint32_t now) {
    axt_modbus_line_receive(&rtu->line, byte, now);
}

/* The answer to a PDU, after the unit id. */
static uint32_t serve(axt_modbus_rtu *rtu, const uint8_t *pdu, uint32_t length, uint32_t now,
                      uint8_t *answer) {
    axt_modbus_request request;
    axt_modbus_exception exception = axt_modbus_parse(pdu, length, &request);
    if (exception == AXT_MODBUS_OK) {
        exception = axt_registers_serve(&rtu->port, &rtu->client, &request, now, rtu->registers);
    }
    return axt_modbus_answer(&request, exception, rtu->registers, answer);
}

uint32_t axt_modbus_rtu_poll(axt_modbus_rtu *rtu, uint32_t now,
                             uint8_t answer[AXT_MODBUS_LINE_FRAME_MAX]) {
    uint8_t frame[AXT_MODBUS_LINE_FRAME_MAX];
    axt_registers_expire(&rtu->client, now);
    const uint32_t length = axt_modbus_line_frame(&rtu->line, now, frame);
    const bool ours = length > 0 && (frame[0] == rtu->unit || frame[0] == AXT_MODBUS_BROADCAST);
    /* a function with the exception bit is an answer, of whoever has our id, too */
    if (!ours || (frame[1] & AXT_MODBUS_EXCEPTION_BIT) != 0) {
        return 0;
    }
    answer[0] = rtu->unit;
    const uint32_t answered = 1 + serve(rtu, frame + 1, length - 1, now, answer + 1);
    return (frame[0] == AXT_MODBUS_BROADCAST) ? 0 : axt_modbus_line_seal(answer, answered);
}
