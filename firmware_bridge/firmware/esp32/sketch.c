/* Entry points of the Arduino core: the board's identity and its loop. Compiled in the tests against shims; NOT RUN ON
 * HARDWARE. */
#include "../board.h"
#include "esp32-hal.h"

void setup(void);
void loop(void);

/* Write the chair's name (at most 16 characters; the --chair-id of `waychair calibrate`) and its joystick family here. No
 * name is given in advance: a board that was never named must not answer to the file of another chair.
#define CHAIR_ID "mine"
#define CHAIR_FAMILY FAMILY_HALL_5V
 */
#if !defined(CHAIR_ID) || !defined(CHAIR_FAMILY)
#error "write the chair's name and its joystick family into sketch.c: CHAIR_ID and CHAIR_FAMILY"
#endif

static const char NAME[CHAIR_ID_LENGTH] = CHAIR_ID;
static const uint8_t FAMILY = CHAIR_FAMILY;

static board self;
static unsigned long last_ms;

void setup(void)
{
    board_config config = {.safety = safety_defaults(FAMILY)};
    for (int i = 0; i < CHAIR_ID_LENGTH; i++)
        config.chair_id[i] = NAME[i];
    board_init(&self, &config);
    last_ms = millis();
}

void loop(void)
{
    const unsigned long now_ms = millis();
    if (now_ms == last_ms)
        return;
    last_ms = now_ms;
    (void)board_step(&self);
}
