/* waychair_glove: the glove's shipped firmware on a computer, with its protocol on a terminal. It reports the motors'
 * levels every millisecond. In lockstep a simulator gives clock, sensors and defects; in real time it runs by itself,
 * worn and in order.
 *
 *   waychair_glove (--serial PATH | --serial-fd N) (--lockstep IN,OUT | --realtime [--levels-fd N])
 *                  [--device ID] [--layout N] [--motors N] [--hand N]
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

#include "../../bytes.h"
#include "../glove_board.h"
#include "hal_host.h"

enum { LONGEST_ADVANCE_MS = 1000, REQUEST_LENGTH = 16, ANSWER_HEAD = 12, RECORD_LENGTH = 4 + GLOVE_MOTORS_MAX, EXIT_USAGE = 2 };

enum { ROOM_TEMPERATURE_C = 25 };

/* Defects of a request: the firmware hangs, or the board has no power. */
enum { DEFECT_NONE, DEFECT_FROZEN, DEFECT_NO_POWER };

typedef struct {
    glove_config config;
    int requests, answers;         /* descriptors of the lockstep, -1 in real time */
    int levels;                    /* descriptor of the levels in real time, -1 for none */
    bool realtime;
} options;

static glove_board BOARD;
static bool in_reset = true;

static int refuse(const char *what, const char *value)
{
    fprintf(stderr, "waychair_glove: %s '%s'; see the head of main.c\n", what, value);
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

static void take_option(options *result, const char *name, const char *value)
{
    if (strcmp(name, "--serial") == 0)
        GLOVE_HOST.serial = open_terminal(value);
    else if (strcmp(name, "--serial-fd") == 0)
        GLOVE_HOST.serial = (int)number(name, value, 1 << 20);
    else if (strcmp(name, "--lockstep") == 0) {
        if (sscanf(value, "%d,%d", &result->requests, &result->answers) != 2)
            refuse("--lockstep takes two descriptors, not", value);
    } else if (strcmp(name, "--levels-fd") == 0)
        result->levels = (int)number(name, value, 1 << 20);
    else if (strcmp(name, "--device") == 0 && strlen(value) <= GLOVE_ID_LENGTH)
        memcpy(result->config.device_id, value, strlen(value));
    else if (strcmp(name, "--layout") == 0)
        result->config.layout = (uint8_t)number(name, value, UINT8_MAX);
    else if (strcmp(name, "--motors") == 0)
        result->config.motors = (uint8_t)number(name, value, GLOVE_MOTORS_MAX);
    else if (strcmp(name, "--hand") == 0)
        result->config.hand = (uint8_t)number(name, value, HAND_RIGHT);
    else
        refuse(name, value);
}

static options read_options(int count, char **words)
{
    options result = {.config = {.layout = 1, .motors = 9, .hand = HAND_RIGHT}, .requests = -1, .answers = -1, .levels = -1};
    for (int i = 1; i < count; i++) {
        if (strcmp(words[i], "--realtime") == 0)
            result.realtime = true;
        else if (i + 1 < count) {
            take_option(&result, words[i], words[i + 1]);
            i++;
        } else
            refuse("nothing follows", words[i]);
    }
    if (GLOVE_HOST.serial < 0 || result.config.motors == 0 || result.realtime == (result.requests >= 0))
        refuse("needs a terminal, motors and either --lockstep or --realtime", "options");
    return result;
}

static void reset_motors(void)
{
    memset(GLOVE_HOST.driven, 0, sizeof GLOVE_HOST.driven);
    in_reset = true;
}

/* Runs one millisecond of the firmware, unless it is hung, unpowered or in reset. */
static void run_once(const glove_config *config, uint8_t defect)
{
    if (defect == DEFECT_NO_POWER || GLOVE_HOST.now_ms - GLOVE_HOST.kick_ms > HOST_WATCHDOG_MS)
        reset_motors();
    if (defect != DEFECT_NONE)
        return;
    if (in_reset)
        glove_board_init(&BOARD, config);
    in_reset = false;
    (void)glove_board_step(&BOARD);
}

/* Request: now_ms u32, received u32, worn u8, pressed buttons u8, temperature i8, defect u8, open u16, shorted u16. */
static void take_request(const uint8_t *request)
{
    glove_inputs *sensed = &GLOVE_HOST.sensed;
    sensed->worn = request[8] != 0;
    sensed->pressed[BUTTON_REPEAT] = (request[9] & 1) != 0;
    sensed->pressed[BUTTON_YES] = (request[9] & 2) != 0;
    sensed->temperature_c = (int8_t)request[10];
    sensed->open = get_u16(request + 12);
    sensed->shorted = get_u16(request + 14);
    glove_host_receive(get_u32(request + 4));
}

/* Answer: sent u32, received u32, number of milliseconds u32, then the 16 levels u8 of each of them. */
static size_t answer(const uint8_t *request, const glove_config *config, uint8_t *result)
{
    take_request(request);
    const uint32_t target = get_u32(request), ahead = target - GLOVE_HOST.now_ms;
    if (ahead == 0 || ahead > LONGEST_ADVANCE_MS)
        GLOVE_HOST.now_ms = target - 1; /* a jump of the clock is one step */
    uint32_t count = 0;
    while (GLOVE_HOST.now_ms != target) {
        GLOVE_HOST.now_ms++;
        run_once(config, request[11]);
        glove_host_levels(result + ANSWER_HEAD + GLOVE_MOTORS_MAX * count++);
    }
    put_u32(put_u32(put_u32(result, GLOVE_HOST.sent), GLOVE_HOST.received), count);
    return ANSWER_HEAD + GLOVE_MOTORS_MAX * (size_t)count;
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

static bool write_all(int descriptor, const uint8_t *bytes, size_t length)
{
    while (length > 0) {
        const ssize_t count = write(descriptor, bytes, length);
        if (count <= 0)
            return false;
        bytes += count;
        length -= (size_t)count;
    }
    return true;
}

static void run_in_lockstep(const options *run)
{
    static uint8_t request[REQUEST_LENGTH], result[ANSWER_HEAD + GLOVE_MOTORS_MAX * LONGEST_ADVANCE_MS];
    while (read_request(run->requests, request))
        if (!write_all(run->answers, result, answer(request, &run->config, result)))
            return;
}

/* Each record of the levels: now_ms u32 of the monotonic clock, 16 levels u8. */
static void run_in_real_time(const options *run)
{
    struct timespec next;
    clock_gettime(CLOCK_MONOTONIC, &next);
    GLOVE_HOST.sensed = (glove_inputs){.worn = true, .temperature_c = ROOM_TEMPERATURE_C};
    for (;;) {
        struct timespec now;
        uint8_t record[RECORD_LENGTH];
        clock_gettime(CLOCK_MONOTONIC, &now);
        GLOVE_HOST.now_ms = (uint32_t)now.tv_sec * 1000u + (uint32_t)(now.tv_nsec / 1000000);
        glove_host_receive(GLOVE_HOST.received);
        run_once(&run->config, DEFECT_NONE);
        glove_host_levels(put_u32(record, GLOVE_HOST.now_ms));
        if (run->levels >= 0 && !write_all(run->levels, record, sizeof record))
            return;
        next.tv_nsec += 1000000;
        if (next.tv_nsec >= 1000000000) {
            next.tv_nsec -= 1000000000;
            next.tv_sec++;
        }
        if (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &next, NULL) != 0 || now.tv_sec > next.tv_sec + 1)
            next = now; /* after a long sleep of the computer it does not catch up */
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
