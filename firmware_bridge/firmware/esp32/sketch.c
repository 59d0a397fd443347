/* Entry points of the Arduino core: the board's identity and its loop. Compiled in the tests against shims; NOT RUN ON
 * HARDWARE. */
#include "../board.h"
#include "esp32-hal.h"

void setup(void);
void loop(void);

/* Change these for each chair; the computer must name the same chair and family. */
static const char CHAIR_ID[CHAIR_ID_LENGTH] = "A";
static const uint8_t FAMILY = FAMILY_HALL_5V;

static board self;
static unsigned long last_ms;

void setup(void)
{
    board_config config = {.safety = safety_defaults(FAMILY)};
    for (int i = 0; i < CHAIR_ID_LENGTH; i++)
        config.chair_id[i] = CHAIR_ID[i];
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
