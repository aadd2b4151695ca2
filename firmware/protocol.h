/* What the trigger board and the host say to each other over USB: numbers and layouts, shared by both sides. */
#ifndef FIRMWARE_PROTOCOL_H
#define FIRMWARE_PROTOCOL_H

#include <stdint.h>

/* Grows when a meaning changes; a host refuses a board that speaks another. */
#define BOARD_PROTOCOL 1

/* pid.codes' pair for tests: must be replaced by identifiers of one's own before boards are given away. */
#define BOARD_VENDOR_ID  0x1209
#define BOARD_PRODUCT_ID 0x0001
#define BOARD_PRODUCT    "nacre trigger board"

/* Time is counted in ticks of the board's crystal, modulo 2^48 (203 days), and travels as 6 bytes. */
#define BOARD_TICK_HZ 16000000UL

/* Everything is little-endian, as the board and the hosts are. */
_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "the protocol is little-endian");

/* Vendor requests to the device on endpoint 0. */
enum board_request {
    BOARD_GET_STATUS = 1, /* in: struct board_status */
    BOARD_SET_SETTINGS =
        2, /* out: struct board_settings; refused (stalled) outside the limits below */
};

#define BOARD_GAIN_MIN     1
#define BOARD_GAIN_MAX     6
#define BOARD_GAIN_DEFAULT 3
#define BOARD_COAST_MAX    32

struct board_settings {
    uint8_t gain; /* of the loop: phase 2^-gain, frequency 2^-(2 gain + 2) of the error, per turn */
    uint8_t
        coast; /* index pulses missing in a row before the lock is given up, 1 to BOARD_COAST_MAX */
    uint8_t report; /* bits of enum board_report */
    uint8_t reserved;
} __attribute__((packed));

enum board_report {
    BOARD_REPORT_INDEX = 1 /* an event for each index pulse too */
};

enum board_state {
    BOARD_LOCKED = 1,   /* to the wheel */
    BOARD_EXPOSING = 2, /* the trigger is high */
    BOARD_PENDING = 4,  /* an exposure waits for its first edge */
};

struct board_status {
    uint8_t protocol; /* BOARD_PROTOCOL; the first byte in every version */
    uint8_t size;     /* of this struct */
    uint8_t state;    /* bits of enum board_state */
    uint8_t waiting;  /* exposures in the queue behind the present one */
    struct board_settings settings;
    uint32_t tick_hz;
    uint8_t now[6];        /* when this status was made */
    uint8_t period[6];     /* of the wheel as the loop has it, in 2^-16 ticks */
    uint32_t turn;         /* number of the turn that begins next */
    uint16_t locked_turns; /* since the lock, at most 65535 */
    uint16_t missed;       /* index pulses that did not come; wraps, like the counts below */
    uint16_t spurious;     /* index pulses at impossible times */
    uint16_t unlocks;      /* times that the lock was lost */
    uint16_t lost;         /* events dropped as the host did not fetch them */
} __attribute__((packed));

/* The bulk out endpoint takes packets of one or more of these. Each is answered by events. */
struct board_command {
    uint8_t command; /* enum board_command_kind */
    uint8_t reserved;
    uint16_t id;    /* chosen by the host, returned in the events */
    uint16_t turns; /* EXPOSE: so many whole turns, 1 to BOARD_TURNS_MAX */
    uint16_t phase; /* EXPOSE: edges come this much of a turn / 65536 after the index */
} __attribute__((packed));

#define BOARD_TURNS_MAX 10000

enum board_command_kind {
    BOARD_EXPOSE = 1, /* as soon as the wheel allows, after those that wait already */
    BOARD_ABORT = 2,  /* end the present exposure at once and forget those that wait */
};

/* The bulk in endpoint gives packets of one to four of these. A packet is never empty. */
struct board_event {
    uint8_t event; /* enum board_event_kind */
    uint8_t
        detail; /* REFUSED: enum board_refusal; FALL: 1 when late; ABORTED, LOST: 1 when the trigger was high */
    uint16_t id;      /* of the exposure */
    uint8_t stamp[6]; /* when it happened; of an edge, the very tick at which the pin moved */
    uint16_t lost;    /* events dropped before this one */
    uint32_t turn;    /* of the wheel */
} __attribute__((packed));

enum board_event_kind {
    BOARD_RISE = 1,    /* the exposure began */
    BOARD_FALL = 2,    /* it ended as asked */
    BOARD_REFUSED = 3, /* a command was not taken */
    BOARD_ABORTED = 4, /* it was ended or forgotten as the host asked */
    BOARD_LOST = 5,    /* the lock was lost while the trigger was high, which was ended at once */
    BOARD_LOCK = 6,    /* to the wheel */
    BOARD_UNLOCK = 7,  /* too many index pulses are missing */
    BOARD_INDEX = 8,   /* an index pulse, where BOARD_REPORT_INDEX is set */
    BOARD_STARTED = 9, /* the board was reset, or plugged in */
};

enum board_refusal {
    BOARD_MALFORMED = 1, /* a packet that is no list of commands, or an unknown command */
    BOARD_FULL = 2,      /* BOARD_WAITING_MAX exposures wait */
    BOARD_BAD_TURNS = 3,
};

#define BOARD_WAITING_MAX 4

/* 48 bits to and from their 6 bytes. */
static inline uint64_t board_get48(const uint8_t bytes[6])
{
    uint64_t value = 0;
    for (uint8_t i = 6; i-- > 0;) {
        value = value << 8 | bytes[i];
    }
    return value;
}

static inline void board_put48(uint8_t bytes[6], uint64_t value)
{
    for (uint8_t i = 0; i < 6; i++) {
        bytes[i] = (uint8_t)value;
        value >>= 8;
    }
}

#endif
