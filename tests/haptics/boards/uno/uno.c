/* An Arduino Uno with the program of a .hex file: UART0 on a pseudo-terminal, pin 9 monitored.
 *
 * Runs in real time, or slower if the machine is too busy (it takes most of a core).
 * Prints the pseudo-terminal's path, then "stamp_ns level" (0 to 255) at every change of the duty cycle of pin 9.
 * cc uno.c -o uno -lsimavr -lelf    (Debian: apt-get install gcc libsimavr-dev libelf-dev)
 */
#define _GNU_SOURCE
#include <fcntl.h>
#include <poll.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_hex.h>

enum { MHZ = 16, SLICE_US = 200, PORTB = 0x25, TCCR1A = 0x80, OCR1AL = 0x88 };

static int master, is_ready = 1;

static int64_t now_ns(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * 1000000000LL + now.tv_nsec;
}

static void on_output(struct avr_irq_t *irq, uint32_t byte, void *param) {
    uint8_t out = byte;
    if (write(master, &out, 1) != 1) perror("pty");
}

static void on_ready(struct avr_irq_t *irq, uint32_t value, void *param) { is_ready = 1; }
static void on_full(struct avr_irq_t *irq, uint32_t value, void *param) { is_ready = 0; }

/* For 0 and 255, analogWrite disables the timer's output and drives the pin directly. */
static int level(avr_t *avr) {
    if (avr->data[TCCR1A] & 0x80) return avr->data[OCR1AL];
    return avr->data[PORTB] & 2 ? 255 : 0;
}

static avr_t *uno(char *hex) {
    uint32_t size, base, flags = 0;
    uint8_t *code = read_ihex_file(hex, &size, &base);
    avr_t *avr = avr_make_mcu_by_name("atmega328p");
    if (!code || !avr) exit(2);
    avr_init(avr);
    avr->frequency = MHZ * 1000000;
    memcpy(avr->flash + base, code, size);
    avr->pc = base;
    avr->codeend = avr->flashend;
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags); /* not to the terminal */
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), on_output, NULL);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUT_XON), on_ready, NULL);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUT_XOFF), on_full, NULL);
    return avr;
}

int main(int count, char **arguments) {
    struct termios raw;
    uint8_t waiting[4096];
    int have = 0, at = 0, before = 0;
    avr_t *avr = uno(arguments[1]);
    avr_irq_t *input = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT);
    master = posix_openpt(O_RDWR | O_NOCTTY);
    grantpt(master);
    unlockpt(master);
    int slave = open(ptsname(master), O_RDWR | O_NOCTTY); /* kept open, so that the terminal does not hang up when a host leaves */
    tcgetattr(slave, &raw);
    cfmakeraw(&raw);
    tcsetattr(slave, TCSANOW, &raw);
    printf("%s\n", ptsname(master));
    fflush(stdout);
    int64_t start_ns = now_ns();
    for (;;) {
        uint64_t due = (uint64_t)(now_ns() - start_ns) * MHZ / 1000;
        for (int slice = 0; avr->cycle < due && slice < 50; slice++) {
            if (at < have && is_ready) avr_raise_irq(input, waiting[at++]);
            uint64_t end = avr->cycle + MHZ * 20;
            while (avr->cycle < end)
                if (avr_run(avr) == cpu_Crashed) return 3;
            if (level(avr) != before) {
                printf("%lld %d\n", (long long)now_ns(), before = level(avr));
                fflush(stdout);
            }
        }
        if (avr->cycle < due) start_ns += (due - avr->cycle) * 1000 / MHZ; /* too slow: shift the time base */
        struct pollfd ready_to_read = {master, POLLIN, 0};
        if (at == have && poll(&ready_to_read, 1, 0) == 1) {
            have = read(master, waiting, sizeof waiting);
            at = 0;
            if (have <= 0) return 0;
        }
        usleep(SLICE_US);
    }
}
