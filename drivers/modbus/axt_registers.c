#include "axt_registers.h"

#include <string.h>

/* Places of what can be written, from the first such register on. */
enum {
    HISTORY_FROM = AXT_REGISTER_HISTORY_FROM - AXT_REGISTER_WRITABLE_FIRST,
    WRITE_KEY = AXT_REGISTER_WRITE_KEY - AXT_REGISTER_WRITABLE_FIRST,
    ARGUMENT = AXT_REGISTER_ARGUMENT - AXT_REGISTER_WRITABLE_FIRST,
    CONTROL_WORD = AXT_REGISTER_CONTROL_WORD - AXT_REGISTER_WRITABLE_FIRST,
    CODE = AXT_REGISTER_CODE - AXT_REGISTER_WRITABLE_FIRST
};

static bool is_inside(uint32_t address, uint32_t count, uint32_t first, uint32_t size) {
    return address >= first && address + count <= first + size;
}

static bool can_be_read(uint32_t address, uint32_t count) {
    for (uint32_t i = 0; i < AXT_REGISTER_BLOCKS; i++) {
        if (is_inside(address, count, axt_register_blocks[i].first, axt_register_blocks[i].count)) {
            return true;
        }
    }
    return false;
}

static bool is_history_from(const axt_modbus_request *request) {
    return request->write_address == AXT_REGISTER_HISTORY_FROM && request->write_count == 2;
}

static bool is_write_key(const axt_modbus_request *request) {
    return request->write_address == AXT_REGISTER_WRITE_KEY && request->write_count == 1;
}

/* The key goes by itself: a request that writes more needs it to have been turned before. */
static bool can_be_written(const axt_registers_client *client, const axt_modbus_request *request) {
    if (is_write_key(request) || is_history_from(request)) {
        return true;
    }
    return client->lock == AXT_REGISTERS_ENABLED &&
           is_inside(request->write_address, request->write_count, AXT_REGISTER_ARGUMENT,
                     AXT_REGISTER_WRITABLE_FIRST + AXT_REGISTER_WRITABLE_COUNT -
                         AXT_REGISTER_ARGUMENT);
}

static void turn_key(axt_registers_client *client, uint16_t key) {
    if (key == AXT_REGISTERS_KEY_FIRST) {
        client->lock = AXT_REGISTERS_KEY_IN;
    } else if (key == AXT_REGISTERS_KEY_SECOND && client->lock == AXT_REGISTERS_KEY_IN) {
        client->lock = AXT_REGISTERS_ENABLED;
    } else {
        client->lock = AXT_REGISTERS_LOCKED;
    }
}

static bool touches(const axt_modbus_request *request, uint32_t address) {
    return is_inside(address, 1, request->write_address, request->write_count);
}

static uint32_t written_uint32(const axt_registers_client *client, uint32_t place) {
    return (uint32_t)client->written[place] << 16 | client->written[place + 1];
}

static axt_modbus_exception write(const axt_registers_port *port, axt_registers_client *client,
                                  const axt_modbus_request *request) {
    const uint32_t first = request->write_address - (uint32_t)AXT_REGISTER_WRITABLE_FIRST;
    for (uint32_t i = 0; i < request->write_count; i++) {
        client->written[first + i] = axt_modbus_written(request, i);
    }
    if (is_write_key(request)) {
        turn_key(client, client->written[WRITE_KEY]);
    }
    axt_modbus_exception exception = AXT_MODBUS_OK;
    if (touches(request, AXT_REGISTER_CODE)) {
        exception = port->command(port->context, client->written[CODE],
                                  written_uint32(client, ARGUMENT), &client->result);
    }
    if (exception == AXT_MODBUS_OK && (touches(request, AXT_REGISTER_CONTROL_WORD) ||
                                       touches(request, AXT_REGISTER_TARGET_TORQUE))) {
        uint16_t none;
        exception = port->command(port->context, AXT_REGISTERS_CONTROL,
                                  written_uint32(client, CONTROL_WORD), &none);
    }
    return exception;
}

static void show_history(const axt_history *history, uint32_t from, uint16_t *registers) {
    enum { MOST = AXT_REGISTER_HISTORY_TORQUE_LENGTH };
    axt_history_sample samples[MOST];
    const uint32_t count = (from == 0) ? axt_history_newest(history, samples, MOST)
                                       : axt_history_from(history, from, samples, MOST);
    registers[AXT_REGISTER_HISTORY_COUNT] = (uint16_t)count;
    axt_registers_put_uint32(registers, AXT_REGISTER_HISTORY_DECIMATION,
                             (count > 1) ? samples[1].n - samples[0].n
                                         : axt_history_decimation(history));
    axt_registers_put_uint32(registers, AXT_REGISTER_HISTORY_COUNTER,
                             (count > 0) ? samples[0].n : 0);
    for (uint32_t i = 0; i < count; i++) {
        axt_registers_put_int32(registers, AXT_REGISTER_HISTORY_MOTOR_POSITION + 2 * i,
                                samples[i].position[0]);
        axt_registers_put_int32(registers, AXT_REGISTER_HISTORY_TABLE_POSITION + 2 * i,
                                samples[i].position[1]);
        registers[AXT_REGISTER_HISTORY_TORQUE + i] = (uint16_t)samples[i].torque;
        registers[AXT_REGISTER_HISTORY_STATUS_WORD + i] = samples[i].status_word;
    }
}

static void read(const axt_registers_port *port, const axt_registers_client *client,
                 uint16_t *registers) {
    port->snapshot(port->context, registers);
    show_history(port->history, written_uint32(client, HISTORY_FROM), registers);
    memcpy(registers + AXT_REGISTER_WRITABLE_FIRST, client->written, sizeof client->written);
    registers[AXT_REGISTER_RESULT] = client->result;
    registers[AXT_REGISTER_WRITE_ENABLED] = (client->lock == AXT_REGISTERS_ENABLED) ? 1 : 0;
}

void axt_registers_expire(axt_registers_client *client, uint32_t now) {
    if (now - client->since > AXT_REGISTERS_ENABLED_US) {
        client->lock = AXT_REGISTERS_LOCKED;
    }
}

axt_modbus_exception axt_registers_serve(const axt_registers_port *port,
                                         axt_registers_client *client,
                                         const axt_modbus_request *request, uint32_t now,
                                         uint16_t registers[AXT_REGISTER_END]) {
    axt_registers_expire(client, now);
    if (client->lock == AXT_REGISTERS_KEY_IN && !is_write_key(request)) {
        client->lock = AXT_REGISTERS_LOCKED; /* the second key has to come at once */
    }
    if (client->lock == AXT_REGISTERS_ENABLED) {
        port->hear_host(port->context);
    }
    const bool writes = request->write_count > 0;
    const bool reads = request->read_count > 0;
    if ((writes && !can_be_written(client, request)) ||
        (reads && !can_be_read(request->read_address, request->read_count))) {
        return AXT_MODBUS_ILLEGAL_ADDRESS;
    }
    if (writes) {
        client->since = now;
        const axt_modbus_exception failed = write(port, client, request);
        if (failed != AXT_MODBUS_OK) {
            return failed;
        }
    }
    if (reads) {
        read(port, client, registers);
    }
    return AXT_MODBUS_OK;
}

void axt_registers_put_uint32(uint16_t *registers, uint32_t address, uint32_t value) {
    registers[address] = (uint16_t)(value >> 16);
    registers[address + 1] = (uint16_t)value;
}

void axt_registers_put_int32(uint16_t *registers, uint32_t address, int32_t value) {
    axt_registers_put_uint32(registers, address, (uint32_t)value);
}

void axt_registers_put_float(uint16_t *registers, uint32_t address, float value) {
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    axt_registers_put_uint32(registers, address, bits);
}
