/* waychair_board: the shipped firmware on a computer, with its protocol on a terminal. In lockstep a simulator gives
 * clock, rider's stick and defects; in real time it runs by itself with the stick at rest.
 *
 *   waychair_board (--serial PATH | --serial-fd N) (--lockstep IN,OUT | --realtime)
 *                  [--family N] [--chair ID] [--dac-bits N] [--neutral PER_MILLE] [--override PER_MILLE]
 *                  [--override-ms N] [--slew-ms N] [--guard-lost PER_MILLE]
 */
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#include "../board.h"
#include "hal_host.h"

enum { LONGEST_ADVANCE_MS = 1000, REQUEST_LENGTH = 20, ANSWER_LENGTH = 16, EXIT_USAGE = 2 };

typedef struct {
    board_config config;
    int requests, answers;         /* descriptors of the lockstep, -1 in real time */
    bool realtime;
} options;

static board BOARD;
static bool in_reset = true;

static int refuse(const char *what, const char *value)
{
    fprintf(stderr, "waychair_board: %s '%s'; see the head of main.c\n", what, value);
    exit(EXIT_USAGE);
}

static long number(const char *option, const char *text, long high)
{
    char *end;
    errno = 0;
    const long value = strtol(text, &end, 10);
    if (errno != 0 || *end != '\0' || end == text || value < 0 || value > high)
        refuse(option, text);
    return value;
}

/* Bytes as they are: no echo, no line editing, no flow control. */
static int open_terminal(const char *path)
{
    const int terminal = open(path, O_RDWR | O_NOCTTY | O_NONBLOCK);
    struct termios mode;
    if (terminal < 0 || tcgetattr(terminal, &mode) != 0)
        return refuse("cannot open the terminal", path);
    mode.c_iflag = 0;
    mode.c_oflag = 0;
    mode.c_lflag = 0;
    mode.c_cflag = CS8 | CREAD | CLOCAL;
    cfsetispeed(&mode, B115200);
    cfsetospeed(&mode, B115200);
    tcsetattr(terminal, TCSANOW, &mode);
    return terminal;
}

static void take_lockstep(options *result, const char *value)
{
    if (sscanf(value, "%d,%d", &result->requests, &result->answers) != 2)
        refuse("--lockstep takes two descriptors, not", value);
}

static void take_option(options *result, const char *name, const char *value)
{
    safety_config *safety = &result->config.safety;
    if (strcmp(name, "--serial") == 0)
        HOST.serial = open_terminal(value);
    else if (strcmp(name, "--serial-fd") == 0)
        HOST.serial = (int)number(name, value, 1 << 20);
    else if (strcmp(name, "--lockstep") == 0)
        take_lockstep(result, value);
    else if (strcmp(name, "--family") == 0)
        safety->family = (uint8_t)number(name, value, UINT8_MAX);
    else if (strcmp(name, "--chair") == 0 && strlen(value) <= CHAIR_ID_LENGTH)
        memcpy(result->config.chair_id, value, strlen(value));
    else if (strcmp(name, "--dac-bits") == 0)
        HOST.converter.bits = (uint8_t)number(name, value, 16);
    else if (strcmp(name, "--neutral") == 0)
        safety->neutral_per_mille = (uint16_t)number(name, value, PER_MILLE);
    else if (strcmp(name, "--override") == 0)
        safety->override_per_mille = (uint16_t)number(name, value, PER_MILLE);
    else if (strcmp(name, "--override-ms") == 0)
        safety->override_ms = (uint16_t)number(name, value, UINT16_MAX);
    else if (strcmp(name, "--slew-ms") == 0)
        safety->slew_ms = (uint16_t)number(name, value, UINT16_MAX);
    else if (strcmp(name, "--guard-lost") == 0)
        safety->guard_lost_per_mille = (uint16_t)number(name, value, PER_MILLE);
    else
        refuse(name, value);
}

static options read_options(int count, char **words)
{
    options result = {.config.safety = safety_defaults(FAMILY_HALL_5V), .requests = -1, .answers = -1};
    HOST.converter.bits = 12;
    for (int i = 1; i < count; i++) {
        if (strcmp(words[i], "--realtime") == 0)
            result.realtime = true;
        else if (i + 1 < count) {
            take_option(&result, words[i], words[i + 1]);
            i++;
        } else
            refuse("nothing follows", words[i]);
    }
    if (HOST.converter.bits < 8 || HOST.serial < 0 || result.realtime == (result.requests >= 0))
        refuse("needs a terminal, 8 to 16 bits and either --lockstep or --realtime", "options");
    HOST.converter.counts_max = (uint16_t)((1u << HOST.converter.bits) - 1);
    return result;
}

/* Runs one millisecond of the hardware and, unless it is hung, unpowered or in reset, of the firmware. */
static safety_outputs run_once(const board_config *config)
{
    static safety_outputs last;
    const bool powered = hardware_tick(&HOST.around);
    const bool hung = HOST.around.broken.kind == DEFECT_FROZEN;
    in_reset = in_reset || !HOST.around.watched;
    if (powered && !hung && in_reset) {
        board_init(&BOARD, config); /* boots; the watchdog starts again */
        in_reset = false;
    }
    if (!powered)
        last = (safety_outputs){0};
    else if (!hung)
        last = board_step(&BOARD);
    (void)hardware_tick(&HOST.around); /* the switch follows within the same millisecond */
    return last;
}

static uint16_t get_u16(const uint8_t *bytes)
{
    return (uint16_t)(bytes[0] | (bytes[1] << 8));
}

static uint32_t get_u32(const uint8_t *bytes)
{
    return (uint32_t)get_u16(bytes) | ((uint32_t)get_u16(bytes + 2) << 16);
}

static void put_u16(uint8_t *bytes, uint32_t value)
{
    bytes[0] = (uint8_t)value;
    bytes[1] = (uint8_t)(value >> 8);
}

/* Request: now_ms u32, received u32, stick u16 x 2, reference u16, e-stop released u8, defect u8, axis u8, 0 u8,
 * value i16. Answer: sent u32, received u32, lines u16 x 2, holder u8, state u8, faults u16. */
static void answer(const uint8_t *request, const board_config *config, uint8_t *result)
{
    hardware *around = &HOST.around;
    around->stick_mv[AXIS_FORWARD] = get_u16(request + 8);
    around->stick_mv[AXIS_TURN] = get_u16(request + 10);
    around->reference_mv = get_u16(request + 12);
    around->estop_released = request[14] != 0;
    around->broken = (defect){request[15], request[16], (int16_t)get_u16(request + 18)};
    host_receive(get_u32(request + 4));
    const uint32_t target = get_u32(request), ahead = target - around->now_ms;
    if (ahead == 0 || ahead > LONGEST_ADVANCE_MS)
        around->now_ms = target - 1; /* a jump of the clock is one step */
    safety_outputs last = {0};
    while (around->now_ms != target) {
        around->now_ms++;
        last = run_once(config);
    }
    put_u16(result, HOST.sent);
    put_u16(result + 2, HOST.sent >> 16);
    put_u16(result + 4, HOST.received);
    put_u16(result + 6, HOST.received >> 16);
    put_u16(result + 8, hardware_line_mv(around, AXIS_FORWARD));
    put_u16(result + 10, hardware_line_mv(around, AXIS_TURN));
    result[12] = around->closed;
    result[13] = last.state;
    put_u16(result + 14, last.faults);
}

static bool read_request(int requests, uint8_t *request)
{
    for (size_t have = 0; have < REQUEST_LENGTH;) {
        const ssize_t count = read(requests, request + have, REQUEST_LENGTH - have);
        if (count <= 0)
            return false;
        have += (size_t)count;
    }
    return true;
}

static void run_in_lockstep(const options *run)
{
    uint8_t request[REQUEST_LENGTH], result[ANSWER_LENGTH];
    while (read_request(run->requests, request)) {
        answer(request, &run->config, result);
        if (write(run->answers, result, sizeof result) != (ssize_t)sizeof result)
            return;
    }
}

static void run_in_real_time(const options *run)
{
    const joystick_family *family = family_find(run->config.safety.family);
    HOST.around.estop_released = true;
    HOST.around.reference_mv = family != NULL ? (uint16_t)family->reference_mv : 0;
    HOST.around.stick_mv[AXIS_FORWARD] = HOST.around.stick_mv[AXIS_TURN] = HOST.around.reference_mv;
    for (;;) {
        struct timespec now, pause = {.tv_sec = 0, .tv_nsec = 1000000};
        clock_gettime(CLOCK_MONOTONIC, &now);
        HOST.around.now_ms = (uint32_t)now.tv_sec * 1000u + (uint32_t)(now.tv_nsec / 1000000);
        host_receive(HOST.received);
        run_once(&run->config);
        nanosleep(&pause, NULL);
    }
}

int main(int count, char **words)
{
    const options run = read_options(count, words);
    signal(SIGPIPE, SIG_IGN);
    if (run.realtime)
        run_in_real_time(&run);
    else
        run_in_lockstep(&run);
    return EXIT_SUCCESS;
}
