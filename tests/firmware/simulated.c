/* The trigger board in simavr. */
#include "simulated.h"

#include <simavr/avr_ioport.h>
#include <simavr/avr_usb.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>
#include <simavr/sim_interrupts.h>
#include <stdlib.h>
#include <string.h>

enum { RAM_FIRST = 0x100, RAM_PAINT = 0xa5, PULSE_CYCLES = 1600 };

/* Uniform in [0, 1). */
static double uniform(uint64_t *seed)
{
    *seed = *seed * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    return (double)(*seed >> 11) * 0x1p-53;
}

static void quiet(avr_t *avr, const int level, const char *format, va_list list)
{
    (void)avr;
    (void)level;
    (void)format;
    (void)list;
}

/* A sleeping core jumps to its next timer at once. */
static void sleep_not(avr_t *avr, avr_cycle_count_t cycles)
{
    (void)avr;
    (void)cycles;
}

static avr_irq_t *index_pin(struct simulated *simulated)
{
    return avr_io_getirq(simulated->avr, AVR_IOCTL_IOPORT_GETIRQ('D'), 4);
}

static avr_cycle_count_t end_pulse(avr_t *avr, avr_cycle_count_t when, void *context)
{
    (void)avr;
    (void)when;
    avr_raise_irq(index_pin(context), 0);
    return 0;
}

/* Which pulses the next turn brings. */
static void plan_turn(struct simulated *simulated)
{
    struct wheel *wheel = &simulated->wheel;
    simulated->pulse = 0;
    simulated->pulse_count = 0;
    double jitter = wheel->jitter * (2 * uniform(&wheel->seed) - 1);
    if (uniform(&wheel->seed) >= wheel->missing) {
        simulated->pulses[simulated->pulse_count++] = simulated->turn_at + jitter;
    }
    double stray = 0.15 + 0.7 * uniform(&wheel->seed);
    if (uniform(&wheel->seed) < wheel->spurious) {
        simulated->pulses[simulated->pulse_count++] = simulated->turn_at + stray * wheel->period;
    }
    if (simulated->turn_count < SIMULATED_TURNS) {
        simulated->turns[simulated->turn_count++] = simulated->turn_at;
    }
    simulated->turn_at += wheel->period;
    wheel->period *= 1 + wheel->drift * wheel->period / CYCLES_PER_SECOND;
}

static avr_cycle_count_t turn_wheel(avr_t *avr, avr_cycle_count_t when, void *context)
{
    struct simulated *simulated = context;
    (void)when;
    if (simulated->wheel.stopped) {
        return 0;
    }
    if (simulated->pulse > 0) {
        avr_raise_irq(index_pin(simulated), 1);
        avr_cycle_timer_register(avr, PULSE_CYCLES, end_pulse, simulated);
    }
    while (simulated->pulse == simulated->pulse_count) {
        plan_turn(simulated);
    }
    return (avr_cycle_count_t)(simulated->pulses[simulated->pulse++] + 0.5);
}

void simulated_turn(struct simulated *simulated, struct wheel wheel)
{
    avr_cycle_timer_cancel(simulated->avr, turn_wheel, simulated);
    simulated->wheel = wheel;
    if (wheel.stopped) {
        return;
    }
    simulated->turn_at = (double)simulated->avr->cycle + 2 * PULSE_CYCLES + wheel.jitter;
    simulated->pulse = 0;
    simulated->pulse_count = 0;
    avr_cycle_timer_register(simulated->avr, 1, turn_wheel, simulated);
}

static void see_trigger(avr_irq_t *irq, uint32_t value, void *context)
{
    struct simulated *simulated = context;
    (void)irq;
    bool high = value & 1;
    bool was = simulated->edge_count > 0 && simulated->edges[simulated->edge_count - 1].high;
    if (high != was && simulated->edge_count < SIMULATED_EDGES) {
        simulated->edges[simulated->edge_count++] =
            (struct pin_edge){.cycle = simulated->avr->cycle, .high = high};
    }
}

static void see_handler(avr_irq_t *irq, uint32_t value, void *context)
{
    struct simulated *simulated = context;
    (void)irq;
    if (value != 0) {
        simulated->handler_began = simulated->avr->cycle;
    } else if (simulated->avr->cycle - simulated->handler_began > simulated->longest_handler) {
        simulated->longest_handler = simulated->avr->cycle - simulated->handler_began;
    }
}

static void see_attach(avr_irq_t *irq, uint32_t value, void *context)
{
    (void)irq;
    ((struct simulated *)context)->attached = value != 0;
}

struct simulated *simulated_new(void)
{
    elf_firmware_t firmware;
    struct simulated *simulated = calloc(1, sizeof *simulated);
    memset(&firmware, 0, sizeof firmware);
    avr_global_logger_set(quiet);
    if (!simulated || elf_read_firmware(TRIGGER_ELF, &firmware) != 0) {
        free(simulated);
        return NULL;
    }
    avr_t *avr = avr_make_mcu_by_name("atmega32u4");
    simulated->avr = avr;
    avr_init(avr);
    firmware.frequency = (uint32_t)CYCLES_PER_SECOND;
    avr_load_firmware(avr, &firmware);
    avr->sleep = sleep_not;
    memset(avr->data + RAM_FIRST, RAM_PAINT, avr->ramend + 1U - RAM_FIRST);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('B'), 5), see_trigger,
                            simulated);
    avr_irq_register_notify(avr_get_interrupt_irq(avr, AVR_INT_ANY) + AVR_INT_IRQ_RUNNING,
                            see_handler, simulated);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_USB_GETIRQ(), USB_IRQ_ATTACH), see_attach,
                            simulated);
    for (uint32_t i = 0; i < firmware.symbolcount; i++) {
        if (strcmp(firmware.symbol[i]->symbol, "overflows") == 0) {
            simulated->overflows = firmware.symbol[i]->addr & 0xffff;
        }
    }
    free(firmware.flash);
    for (int ms = 0; ms < 100 && !simulated->attached; ms++) {
        simulated_run(simulated, CYCLES_PER_SECOND / 1000);
    }
    simulated_run(simulated, CYCLES_PER_SECOND / 100);
    return simulated;
}

void simulated_free(struct simulated *simulated)
{
    if (simulated) {
        avr_terminate(simulated->avr);
        free(simulated->avr);
        free(simulated);
    }
}

/* Only so that a sleeping core wakes up at the end of a run. */
static avr_cycle_count_t stop(avr_t *avr, avr_cycle_count_t when, void *context)
{
    (void)avr;
    (void)when;
    (void)context;
    return 0;
}

void simulated_run(struct simulated *simulated, double cycles)
{
    avr_t *avr = simulated->avr;
    avr_cycle_count_t end = avr->cycle + (avr_cycle_count_t)cycles;
    avr_cycle_timer_register(avr, (avr_cycle_count_t)cycles, stop, simulated);
    while (avr->cycle < end) {
        int state = avr_run(avr);
        if (state == cpu_Done || state == cpu_Crashed) {
            return;
        }
    }
}

bool simulated_set_clock(struct simulated *simulated, uint64_t ticks)
{
    uint32_t overflows = (uint32_t)(ticks >> 16);
    if (simulated->overflows < RAM_FIRST) {
        return false;
    }
    memcpy(simulated->avr->data + simulated->overflows, &overflows, sizeof overflows);
    return true;
}

int simulated_ram(const struct simulated *simulated)
{
    const avr_t *avr = simulated->avr;
    int total = (int)avr->ramend + 1 - RAM_FIRST;
    int longest = 0;
    int untouched = 0;
    for (int i = RAM_FIRST; i <= (int)avr->ramend; i++) {
        untouched = avr->data[i] == RAM_PAINT ? untouched + 1 : 0;
        longest = untouched > longest ? untouched : longest;
    }
    return total - longest;
}

/* Try a USB operation every tenth of a millisecond until it is neither refused for now (NAK) nor, for bulk in, empty. */
static int attempt(struct simulated *simulated, uint32_t operation, uint8_t endpoint, void *data,
                   int size, int timeout_ms, bool empty_is_nak)
{
    if (simulated->unplugged) {
        return SIMULATED_GONE;
    }
    for (int try = 0; try <= 10 * timeout_ms; try++) {
        struct avr_io_usb io = {.pipe = endpoint, .sz = (uint32_t)size, .buf = data};
        int result = avr_ioctl(simulated->avr, operation, &io);
        if (result == AVR_IOCTL_USB_STALL) {
            return SIMULATED_STALL;
        }
        if (result == 0 && !(empty_is_nak && io.sz == 0)) {
            return (int)io.sz;
        }
        simulated_run(simulated, CYCLES_PER_SECOND / 10000);
    }
    return SIMULATED_TIMEOUT;
}

int simulated_control(struct simulated *simulated, uint8_t type, uint8_t request, uint16_t value,
                      uint16_t index, void *data, uint16_t size, int timeout_ms)
{
    uint8_t setup[8] = {type,           request,
                        (uint8_t)value, (uint8_t)(value >> 8),
                        (uint8_t)index, (uint8_t)(index >> 8),
                        (uint8_t)size,  (uint8_t)(size >> 8)};
    uint8_t packet[64];
    int moved = attempt(simulated, AVR_IOCTL_USB_SETUP, 0, setup, sizeof setup, timeout_ms, false);
    if (moved < 0) {
        return moved;
    }
    /* The chip needs a moment to see the request, whose answer must not be taken for an older one. */
    simulated_run(simulated, CYCLES_PER_SECOND / 1000);
    if (type & 0x80) {
        moved = attempt(simulated, AVR_IOCTL_USB_READ, 0, packet, 0, timeout_ms, false);
        if (moved < 0) {
            return moved;
        }
        moved = moved < size ? moved : size;
        memcpy(data, packet, (size_t)moved);
        int done = attempt(simulated, AVR_IOCTL_USB_WRITE, 0, packet, 0, timeout_ms, false);
        return done < 0 ? done : moved;
    }
    if (size > 0) {
        moved = attempt(simulated, AVR_IOCTL_USB_WRITE, 0, data, size, timeout_ms, false);
        if (moved < 0) {
            return moved;
        }
        simulated_run(simulated, CYCLES_PER_SECOND / 1000);
    }
    moved = attempt(simulated, AVR_IOCTL_USB_READ, 0, packet, 0, timeout_ms, false);
    return moved < 0 ? moved : size;
}

int simulated_out(struct simulated *simulated, uint8_t endpoint, const void *data, int size,
                  int timeout_ms)
{
    uint8_t packet[64];
    if (size > (int)sizeof packet) {
        return SIMULATED_STALL;
    }
    memcpy(packet, data, (size_t)size);
    return attempt(simulated, AVR_IOCTL_USB_WRITE, endpoint, packet, size, timeout_ms, false);
}

int simulated_in(struct simulated *simulated, uint8_t endpoint, void *data, int size,
                 int timeout_ms)
{
    uint8_t packet[64];
    int moved =
        attempt(simulated, AVR_IOCTL_USB_READ, endpoint & 0x7f, packet, 0, timeout_ms, true);
    if (moved > size) {
        moved = size;
    }
    if (moved > 0) {
        memcpy(data, packet, (size_t)moved);
    }
    return moved;
}

bool simulated_enumerate(struct simulated *simulated)
{
    (void)avr_ioctl(simulated->avr, AVR_IOCTL_USB_RESET, NULL);
    simulated_run(simulated, CYCLES_PER_SECOND / 1000);
    return simulated_control(simulated, 0x00, 5, 7, 0, NULL, 0, 50) == 0 &&
           simulated_control(simulated, 0x00, 9, 1, 0, NULL, 0, 50) == 0;
}
