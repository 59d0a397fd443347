/* The loop of a glove: see glove_board.h. */
#include "glove_board.h"

#include <string.h>

#include "glove_hal.h"

enum { RECEIVE_MAX = 64 }; /* per step; 115200 baud bring 12 bytes a millisecond */

void glove_board_init(glove_board *self, const glove_config *config)
{
    memset(self, 0, sizeof *self);
    self->config = *config;
    glove_init(&self->core, config->motors);
    frame_decoder_init(&self->decoder);
    glove_hal_begin(config->motors);
}

static void send(glove_board *self, frame *message)
{
    uint8_t wire[FRAME_WIRE_MAX];
    message->sequence = self->sequence++;
    glove_hal_write(wire, frame_encode(message, wire));
}

static uint8_t refusal(const glove_board *self, const glove_hello *theirs)
{
    uint8_t refused = 0;
    if (theirs->version != GLOVE_PROTOCOL_VERSION)
        refused |= GLOVE_REFUSED_VERSION;
    if (theirs->layout_hash != GLOVE_LAYOUT_HASH)
        refused |= GLOVE_REFUSED_TABLE;
    if (memcmp(theirs->device_id, self->config.device_id, GLOVE_ID_LENGTH) != 0)
        refused |= GLOVE_REFUSED_DEVICE;
    if (theirs->layout != self->config.layout)
        refused |= GLOVE_REFUSED_LAYOUT;
    return refused;
}

static void reply(glove_board *self, uint8_t refused)
{
    glove_reply ours = {
        .version = GLOVE_PROTOCOL_VERSION,
        .layout_hash = GLOVE_LAYOUT_HASH,
        .firmware_version = GLOVE_FIRMWARE_VERSION,
        .layout = self->config.layout,
        .motors = self->config.motors,
        .hand = self->config.hand,
        .refused = refused,
    };
    memcpy(ours.device_id, self->config.device_id, GLOVE_ID_LENGTH);
    frame message;
    glove_write_reply(&ours, &message);
    send(self, &message);
}

static void understand(glove_board *self, const frame *received, glove_message *message)
{
    glove_hello theirs;
    if (glove_read_hello(received, &theirs)) {
        const uint8_t refused = refusal(self, &theirs);
        message->event = GLOVE_HELLO;
        message->sequence = received->sequence;
        message->hello_matches = refused == 0;
        reply(self, refused);
    } else if (!glove_read_order(received, message)) {
        message->event = GLOVE_NOTHING;
        self->bad_frames++;
    }
}

/* Takes up to one frame: a burst of frames takes as many steps. The number of bytes is limited, so that a flood of bytes
 * does not keep the loop from its watchdog. */
static void receive(glove_board *self, glove_message *message)
{
    uint8_t byte;
    for (int taken = 0; taken < RECEIVE_MAX && glove_hal_read_byte(&byte); taken++) {
        frame received;
        const decoded what = frame_decode(&self->decoder, byte, &received);
        if (what == DECODED_BAD)
            self->bad_frames++;
        if (what == DECODED_FRAME) {
            understand(self, &received, message);
            return;
        }
    }
}

static uint16_t mask_of(const uint8_t level[GLOVE_MOTORS_MAX])
{
    unsigned mask = 0;
    for (int motor = 0; motor < GLOVE_MOTORS_MAX; motor++)
        mask |= (unsigned)(level[motor] > 0) << motor;
    return (uint16_t)mask;
}

static void report(glove_board *self, const glove_inputs *inputs)
{
    glove_core *core = &self->core;
    const glove_status ours = {
        .state = core->state,
        .playing = core->playing,
        .sequence = core->pattern.sequence,
        .step = core->at,
        .on = mask_of(core->level),
        .judged = core->judged,
        .refused = core->refused,
        .cut = core->cut,
        .open = inputs->open,
        .shorted = inputs->shorted,
        .worn = inputs->worn,
        .presses = {core->presses[BUTTON_REPEAT], core->presses[BUTTON_YES]},
        .temperature_c = inputs->temperature_c,
        .board_ms = core->now_ms,
        .bad_frames = self->bad_frames,
        .rejected = self->rejected,
    };
    frame message;
    glove_write_status(&ours, &message);
    send(self, &message);
    core->cut = 0;
    self->status_ms = core->now_ms;
}

glove_outputs glove_board_step(glove_board *self)
{
    glove_inputs inputs = {0};
    glove_outputs outputs;
    glove_hal_sense(&inputs);
    receive(self, &inputs.host);
    glove_step_core(&self->core, &inputs, glove_hal_now_ms(), &outputs);
    glove_hal_put(outputs.level);
    if (inputs.host.event != GLOVE_NOTHING && !outputs.heard)
        self->rejected++;
    const bool judged = outputs.heard && inputs.host.event == GLOVE_PLAY;
    if (judged || self->core.now_ms - self->status_ms >= GLOVE_STATUS_MS)
        report(self, &inputs);
    glove_hal_kick();
    return outputs;
}
