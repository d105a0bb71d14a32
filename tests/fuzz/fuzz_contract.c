/* The generated codec of the CAN contract: any bytes as a frame, any bits as a message.
 *
 * The input is a byte that chooses the message, and its frame or struct. What must hold: a message
 * that was unpacked is packed and unpacked to the same, and so is the frame of any message. */
#include "axt_contract.h"
#include "messages.h"
#include "raw.h"

#define TARGET(name, NAME)                                                                         \
    static void try_##name(const uint8_t *bytes) {                                                 \
        enum { LENGTH = AXT_CONTRACT_##NAME##_LENGTH };                                            \
        struct axt_contract_##name##_t message;                                                    \
        struct axt_contract_##name##_t again;                                                      \
        uint8_t frame[LENGTH];                                                                     \
        uint8_t frame_again[LENGTH];                                                               \
        memset(&message, 0, sizeof message);                                                       \
        memset(&again, 0, sizeof again);                                                           \
        expect(axt_contract_##name##_unpack(&message, bytes, LENGTH) == 0);                        \
        expect(axt_contract_##name##_pack(frame, &message, LENGTH) == LENGTH);                     \
        expect(axt_contract_##name##_unpack(&again, frame, LENGTH) == 0);                          \
        expect(memcmp(&again, &message, sizeof message) == 0);                                     \
        memcpy(&message, bytes, sizeof message);                                                   \
        expect(axt_contract_##name##_pack(frame, &message, LENGTH) == LENGTH);                     \
        expect(axt_contract_##name##_unpack(&message, frame, LENGTH) == 0);                        \
        expect(axt_contract_##name##_pack(frame_again, &message, LENGTH) == LENGTH);               \
        expect(memcmp(frame_again, frame, LENGTH) == 0);                                           \
    }
CONTRACT_MESSAGES(TARGET)

#define ENTRY(name, NAME) try_##name,

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static void (*const try_message[])(const uint8_t *) = {CONTRACT_MESSAGES(ENTRY)};
    raw_bytes in = {data, size};
    const uint8_t which = take_byte(&in);
    uint8_t bytes[512] = {0};
    memcpy(bytes, in.next, (in.left < sizeof bytes) ? in.left : sizeof bytes);
    try_message[which % (sizeof try_message / sizeof try_message[0])](bytes);
    return 0;
}
