/* semihosting.h - how a program on an emulated Cortex-M talks to the host: Arm's semihosting calls.
 */
#ifndef SEMIHOSTING_H
#define SEMIHOSTING_H

/* Writes a string to the host's console. */
void semihosting_write(const char *text);

/* Ends the emulator with this exit status. */
_Noreturn void semihosting_exit(int status);

#endif
