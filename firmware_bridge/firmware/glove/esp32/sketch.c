/* Entry points of the Arduino core: the glove's identity and its loop. Compiled in the tests against shims; NOT RUN ON
 * HARDWARE. */
#include "../glove_board.h"
#include "esp32-hal.h"

void setup(void);
void loop(void);

/* Write the glove's name (at most 16 characters), the number of its layout and of its motors (glove/layouts.yaml) and its
 * hand here. No name is given in advance: a glove that was never named must not answer to another rider's file.
#define GLOVE_ID "mine"
#define GLOVE_LAYOUT 1
#define GLOVE_MOTORS 9
#define GLOVE_HAND HAND_RIGHT
 */
#if !defined(GLOVE_ID) || !defined(GLOVE_LAYOUT) || !defined(GLOVE_MOTORS) || !defined(GLOVE_HAND)
#error "write the glove's name, layout, motors and hand into sketch.c"
#endif

static const char NAME[GLOVE_ID_LENGTH] = GLOVE_ID;

static glove_board self;
static unsigned long last_ms;

void setup(void)
{
    glove_config config = {.layout = GLOVE_LAYOUT, .motors = GLOVE_MOTORS, .hand = GLOVE_HAND};
    for (int i = 0; i < GLOVE_ID_LENGTH; i++)
        config.device_id[i] = NAME[i];
    glove_board_init(&self, &config);
    last_ms = millis();
}

void loop(void)
{
    const unsigned long now_ms = millis();
    if (now_ms == last_ms)
        return;
    last_ms = now_ms;
    (void)glove_board_step(&self);
}
