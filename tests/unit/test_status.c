/* Statuses: zero is fine, errors are negative, and each has a line of its own. */
#include "axt_status.h"

#include "check.h"
#include "reference.h"

static const axt_status statuses[] = {AXT_OK,         AXT_ERROR_RANGE,   AXT_ERROR_NOT_FINITE,
                                      AXT_ERROR_SIZE, AXT_ERROR_NO_DATA, AXT_ERROR_REPEATED,
                                      AXT_ERROR_JUMP};

CASE(fine_is_zero_and_errors_are_negative) {
    CHECK_EQUAL(AXT_OK, 0);
    for (size_t i = 1; i < COUNT_OF(statuses); i++) {
        CHECK(statuses[i] < 0);
    }
}

CASE(each_status_has_a_line_of_its_own) {
    for (size_t i = 0; i < COUNT_OF(statuses); i++) {
        const char *line = axt_status_string(statuses[i]);
        CHECK(strlen(line) > 0);
        CHECK(strchr(line, '\n') == NULL);
        CHECK(strcmp(line, "unknown status") != 0);
        for (size_t j = 0; j < i; j++) {
            CHECK(strcmp(line, axt_status_string(statuses[j])) != 0);
        }
    }
}

CASE(any_other_number_is_an_unknown_status) {
    const int others[] = {1, -7, 1000, -1000};
    for (size_t i = 0; i < COUNT_OF(others); i++) {
        CHECK(strcmp(axt_status_string((axt_status)others[i]), "unknown status") == 0);
    }
}

int main(void) {
    RUN(fine_is_zero_and_errors_are_negative);
    RUN(each_status_has_a_line_of_its_own);
    RUN(any_other_number_is_an_unknown_status);
    return REPORT();
}
