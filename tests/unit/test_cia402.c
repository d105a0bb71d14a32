/* CiA 402's state machine, against its table of transitions. */
#include "axt_cia402.h"

#include "check.h"

enum { COMMANDS = 5, SHUTDOWN = 0, SWITCH_ON, ENABLE_OPERATION, DISABLE_VOLTAGE, QUICK_STOP };

/* Control words: which of the bits 0 to 3 must be what (CiA 402, table of the control word's
 * commands), in the order above. Bit 7, fault reset, is looked at by itself. */
static const struct {
    uint16_t mask;
    uint16_t bits;
} commands[COMMANDS] = {
    {0x0007, 0x0006}, {0x000F, 0x0007}, {0x000F, 0x000F}, {0x0002, 0x0000}, {0x0006, 0x0002}};

static const struct {
    axt_cia402_state from;
    int command;
    axt_cia402_state to;
} transitions[] = {
    {AXT_CIA402_SWITCH_ON_DISABLED, SHUTDOWN, AXT_CIA402_READY},                    /* 2 */
    {AXT_CIA402_READY, SWITCH_ON, AXT_CIA402_SWITCHED_ON},                          /* 3 */
    {AXT_CIA402_READY, ENABLE_OPERATION, AXT_CIA402_OPERATION_ENABLED},             /* 3 and 4 */
    {AXT_CIA402_SWITCHED_ON, ENABLE_OPERATION, AXT_CIA402_OPERATION_ENABLED},       /* 4 */
    {AXT_CIA402_OPERATION_ENABLED, SWITCH_ON, AXT_CIA402_SWITCHED_ON},              /* 5 */
    {AXT_CIA402_SWITCHED_ON, SHUTDOWN, AXT_CIA402_READY},                           /* 6 */
    {AXT_CIA402_READY, DISABLE_VOLTAGE, AXT_CIA402_SWITCH_ON_DISABLED},             /* 7 */
    {AXT_CIA402_READY, QUICK_STOP, AXT_CIA402_SWITCH_ON_DISABLED},                  /* 7 */
    {AXT_CIA402_OPERATION_ENABLED, SHUTDOWN, AXT_CIA402_READY},                     /* 8 */
    {AXT_CIA402_OPERATION_ENABLED, DISABLE_VOLTAGE, AXT_CIA402_SWITCH_ON_DISABLED}, /* 9 */
    {AXT_CIA402_SWITCHED_ON, DISABLE_VOLTAGE, AXT_CIA402_SWITCH_ON_DISABLED},       /* 10 */
    {AXT_CIA402_SWITCHED_ON, QUICK_STOP, AXT_CIA402_SWITCH_ON_DISABLED},            /* 10 */
    {AXT_CIA402_OPERATION_ENABLED, QUICK_STOP, AXT_CIA402_QUICK_STOP_ACTIVE},       /* 11 */
    {AXT_CIA402_QUICK_STOP_ACTIVE, DISABLE_VOLTAGE, AXT_CIA402_SWITCH_ON_DISABLED}, /* 12 */
    {AXT_CIA402_QUICK_STOP_ACTIVE, ENABLE_OPERATION, AXT_CIA402_OPERATION_ENABLED}, /* 16 */
};

/* Words that ask for what is so already. */
static const struct {
    axt_cia402_state state;
    int command;
} stays[] = {
    {AXT_CIA402_NOT_READY, DISABLE_VOLTAGE},
    {AXT_CIA402_SWITCH_ON_DISABLED, DISABLE_VOLTAGE},
    {AXT_CIA402_SWITCH_ON_DISABLED, QUICK_STOP},
    {AXT_CIA402_READY, SHUTDOWN},
    {AXT_CIA402_SWITCHED_ON, SWITCH_ON},
    {AXT_CIA402_OPERATION_ENABLED, ENABLE_OPERATION},
    {AXT_CIA402_QUICK_STOP_ACTIVE, QUICK_STOP},
    {AXT_CIA402_FAULT_REACTION_ACTIVE, DISABLE_VOLTAGE},
    {AXT_CIA402_FAULT, DISABLE_VOLTAGE},
};

static const axt_cia402_state states[] = {AXT_CIA402_NOT_READY,
                                          AXT_CIA402_SWITCH_ON_DISABLED,
                                          AXT_CIA402_READY,
                                          AXT_CIA402_SWITCHED_ON,
                                          AXT_CIA402_OPERATION_ENABLED,
                                          AXT_CIA402_QUICK_STOP_ACTIVE,
                                          AXT_CIA402_FAULT_REACTION_ACTIVE,
                                          AXT_CIA402_FAULT};

static int command_of(uint16_t word) {
    int found = -1;
    for (int i = 0; i < COMMANDS; i++) {
        if ((word & commands[i].mask) == commands[i].bits) {
            CHECK_EQUAL(found, -1); /* a word is one command */
            found = i;
        }
    }
    return found;
}

/* Where the table leads; false when it has no such transition. */
static bool expected_next(axt_cia402_state state, uint16_t before, uint16_t word,
                          axt_cia402_state *next) {
    if (state == AXT_CIA402_FAULT && (before & 0x80) == 0 && (word & 0x80) != 0) {
        *next = AXT_CIA402_SWITCH_ON_DISABLED; /* 15 */
        return true;
    }
    const int command = command_of(word);
    for (size_t i = 0; i < sizeof transitions / sizeof transitions[0]; i++) {
        if (transitions[i].from == state && transitions[i].command == command) {
            *next = transitions[i].to;
            return true;
        }
    }
    for (size_t i = 0; i < sizeof stays / sizeof stays[0]; i++) {
        if (stays[i].state == state && stays[i].command == command) {
            *next = state;
            return true;
        }
    }
    return false;
}

/* Every state, every control word after words with and without the reset bit. */
CASE(every_control_word_leads_where_the_table_says) {
    static const uint16_t befores[] = {0x0000, 0x0080, 0x000F, 0x008F};
    for (size_t s = 0; s < sizeof states / sizeof states[0]; s++) {
        for (size_t b = 0; b < sizeof befores / sizeof befores[0]; b++) {
            for (uint32_t word = 0; word <= 0xFFFF; word++) {
                axt_cia402_state expected = AXT_CIA402_NOT_READY;
                axt_cia402_state next = AXT_CIA402_NOT_READY;
                const bool is = expected_next(states[s], befores[b], (uint16_t)word, &expected);
                CHECK_EQUAL(axt_cia402_next(states[s], befores[b], (uint16_t)word, &next), is);
                CHECK_EQUAL(next, expected); /* as it was when there is none */
            }
        }
    }
}

/* Status words of CiA 402: value under mask for each state. */
CASE(states_are_what_the_status_word_shows) {
    static const struct {
        uint16_t mask;
        uint16_t bits;
    } shown[] = {{0x4F, 0x00}, {0x4F, 0x40}, {0x6F, 0x21}, {0x6F, 0x23},
                 {0x6F, 0x27}, {0x6F, 0x07}, {0x4F, 0x0F}, {0x4F, 0x08}};
    for (size_t s = 0; s < sizeof states / sizeof states[0]; s++) {
        for (size_t i = 0; i < sizeof shown / sizeof shown[0]; i++) {
            CHECK_EQUAL(((uint32_t)states[s] & shown[i].mask) == shown[i].bits, s == i);
        }
        CHECK_EQUAL((uint32_t)states[s] & ~(uint32_t)AXT_CIA402_STATE_MASK, 0);
    }
}

int main(void) {
    RUN(every_control_word_leads_where_the_table_says);
    RUN(states_are_what_the_status_word_shows);
    return REPORT();
}
