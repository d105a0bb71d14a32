/* Every message of the contract, packed and unpacked.
 *
 * Precondition: none. Any struct, any bytes, any size of the buffer.
 *
 * A buffer that is too short is proven to be left alone by passing a pointer to none. */
#include "any.h"
#include "axt_contract.h"
#include "messages.h"

#define PROVE(name, NAME)                                                                          \
    static void prove_##name(void) {                                                               \
        struct axt_contract_##name##_t message;                                                    \
        uint8_t frame[AXT_CONTRACT_##NAME##_LENGTH];                                               \
        const size_t short_of_it = any_size(0, sizeof frame - 1);                                  \
        ANY(message);                                                                              \
        (void)axt_contract_##name##_pack(frame, &message, sizeof frame);                           \
        (void)axt_contract_##name##_pack(NULL, &message, short_of_it);                             \
        ANY(frame);                                                                                \
        (void)axt_contract_##name##_unpack(&message, frame, sizeof frame);                         \
        (void)axt_contract_##name##_unpack(&message, NULL, short_of_it);                           \
        (void)axt_contract_##name##_init(&message);                                                \
    }

AXT_PROOF_MESSAGES(PROVE)

#define CALL(name, NAME) prove_##name();

int main(void) {
    AXT_PROOF_MESSAGES(CALL)
    return 0;
}
