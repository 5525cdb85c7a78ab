/* An Arduino Uno with the program of a .hex file: UART0 on a pseudo-terminal, pin 9 monitored; on its I2C bus a
 * TCA9548A at 0x70 with a DRV2605L on each of channels 0 and 1.
 *
 * Runs in real time, or slower if the machine is too busy (it takes most of a core).
 * Prints the pseudo-terminal's path, then "stamp_ns pin first second" (0 to 255) at every change of the duty cycle of
 * pin 9 or of what a driver plays. If a third argument is given, the second driver does not acknowledge.
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

#include <simavr/avr_twi.h>
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

/* --- the I2C bus: what a driver holds in its registers, SLOS854D, and the multiplexer's mask, SCPS207G --- */

enum { MULTIPLEXER = 0x70, DRIVER = 0x5A, REGISTERS = 0x23, STATUS = 0, MODE = 1, AMPLITUDE = 2, STANDBY = 0x40 };

static struct { uint8_t registers[REGISTERS], pointer; int is_deaf; } drivers[2];
static uint8_t mask;
static int selected = -1, bytes;
static avr_irq_t *bus;

static int plays(int number) {
    return drivers[number].registers[MODE] == 5 ? drivers[number].registers[AMPLITUDE] : 0;
}

static int listens(int number) { return mask >> number & 1 && !drivers[number].is_deaf; }

static int acknowledges(int address) {
    return address == MULTIPLEXER || (address == DRIVER && (listens(0) || listens(1)));
}

static void take(uint8_t byte) {
    if (selected == MULTIPLEXER) mask = byte;
    for (int number = 0; selected == DRIVER && number < 2; number++) {
        if (!listens(number)) continue;
        uint8_t *pointer = &drivers[number].pointer, *registers = drivers[number].registers;
        if (bytes == 0) *pointer = byte % REGISTERS;
        else {
            if (*pointer == MODE || *pointer == AMPLITUDE || !(registers[MODE] & STANDBY)) registers[*pointer] = byte;
            *pointer = (*pointer + 1) % REGISTERS;
        }
    }
    bytes++;
}

static uint8_t give(void) {
    int all = 0xFF; /* an open drain: a zero wins */
    if (selected == MULTIPLEXER) return mask;
    for (int number = 0; number < 2; number++)
        if (listens(number)) {
            all &= drivers[number].registers[drivers[number].pointer];
            drivers[number].pointer = (drivers[number].pointer + 1) % REGISTERS;
        }
    return all;
}

static void on_bus(struct avr_irq_t *irq, uint32_t value, void *param) {
    avr_twi_msg_irq_t message = {.u.v = value};
    if (message.u.twi.msg & TWI_COND_STOP) selected = -1;
    if (message.u.twi.msg & TWI_COND_START) {
        int address = message.u.twi.addr >> 1;
        selected = acknowledges(address) ? address : -1;
        bytes = 0;
        if (selected >= 0)
            avr_raise_irq(bus + TWI_IRQ_INPUT, avr_twi_irq_msg(TWI_COND_ACK, message.u.twi.addr, 1));
    }
    if (selected < 0) return;
    if (message.u.twi.msg & TWI_COND_WRITE) {
        take(message.u.twi.data);
        avr_raise_irq(bus + TWI_IRQ_INPUT, avr_twi_irq_msg(TWI_COND_ACK, message.u.twi.addr, 1));
    }
    if (message.u.twi.msg & TWI_COND_READ)
        avr_raise_irq(bus + TWI_IRQ_INPUT, avr_twi_irq_msg(TWI_COND_READ, message.u.twi.addr, give()));
}

static void connect_drivers(avr_t *avr, int is_second_deaf) {
    for (int number = 0; number < 2; number++) {
        drivers[number].registers[STATUS] = 0xE0;
        drivers[number].registers[MODE] = STANDBY;
    }
    drivers[1].is_deaf = is_second_deaf;
    bus = avr_io_getirq(avr, AVR_IOCTL_TWI_GETIRQ(0), 0);
    avr_irq_register_notify(bus + TWI_IRQ_OUTPUT, on_bus, NULL);
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
    int have = 0, at = 0, before[3] = {0};
    avr_t *avr = uno(arguments[1]);
    connect_drivers(avr, count > 2);
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
            int now[3] = {level(avr), plays(0), plays(1)};
            if (memcmp(now, before, sizeof now)) {
                memcpy(before, now, sizeof now);
                printf("%lld %d %d %d\n", (long long)now_ns(), now[0], now[1], now[2]);
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
