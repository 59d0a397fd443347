/* The board's loop: see board.h. */
#include "board.h"

#include <string.h>

#include "hal.h"

enum { RECEIVE_MAX = 64 }; /* per step; 115200 baud bring 12 bytes a millisecond */

void board_init(board *self, const board_config *config)
{
    memset(self, 0, sizeof *self);
    self->config = *config;
    self->converter_ok = true;
    self->configured = safety_init(&self->core, &config->safety);
    frame_decoder_init(&self->decoder);
    hal_begin(self->core.family);
}

static void send(board *self, frame *message)
{
    uint8_t wire[FRAME_WIRE_MAX];
    message->sequence = self->sequence++;
    hal_write(wire, frame_encode(message, wire));
}

static uint8_t refusal(const board *self, const hello *theirs)
{
    uint8_t refused = 0;
    if (theirs->version != PROTOCOL_VERSION)
        refused |= REFUSED_VERSION;
    if (theirs->layout_hash != PROTOCOL_LAYOUT_HASH)
        refused |= REFUSED_LAYOUT;
    if (memcmp(theirs->chair_id, self->config.chair_id, CHAIR_ID_LENGTH) != 0)
        refused |= REFUSED_CHAIR;
    if (theirs->family != self->config.safety.family)
        refused |= REFUSED_FAMILY;
    if (!self->configured)
        refused |= REFUSED_CONFIG;
    return refused;
}

static void reply(board *self, uint8_t refused)
{
    const hal_converter converter = hal_converter_of_board();
    hello_reply ours = {
        .version = PROTOCOL_VERSION,
        .layout_hash = PROTOCOL_LAYOUT_HASH,
        .firmware_version = FIRMWARE_VERSION,
        .family = self->config.safety.family,
        .refused = refused,
        .dac_bits = converter.bits,
        .dac_counts_max = converter.counts_max,
    };
    memcpy(ours.chair_id, self->config.chair_id, CHAIR_ID_LENGTH);
    const joystick_family *family = self->core.family;
    if (family != NULL) {
        ours.reference_mv = (uint16_t)family->reference_mv;
        ours.swing_mv = (uint16_t)family->swing_mv;
        ours.dac_low_mv = (uint16_t)family->dac_low_mv;
        ours.dac_high_mv = (uint16_t)family->dac_high_mv;
    }
    frame message;
    protocol_write_hello_reply(&ours, &message);
    send(self, &message);
}

/* `stamp_us` is that of a command or limit. */
static host_message understand(board *self, const frame *received, uint32_t *stamp_us)
{
    hello theirs;
    command order;
    limit caps;
    host_message message = {.event = EVENT_BAD_FRAME, .sequence = received->sequence};
    if (protocol_read_hello(received, &theirs)) {
        const uint8_t refused = refusal(self, &theirs);
        message.event = EVENT_HELLO;
        message.hello_matches = refused == 0;
        reply(self, refused);
    } else if (protocol_read_command(received, &order)) {
        message.event = EVENT_COMMAND;
        message.flags = order.flags;
        memcpy(message.setpoint, order.setpoint, sizeof message.setpoint);
        *stamp_us = order.stamp_us;
    } else if (protocol_read_limit(received, &caps)) {
        message.event = EVENT_LIMIT;
        message.flags = caps.flags;
        memcpy(message.caps, caps.caps, sizeof message.caps);
        *stamp_us = caps.stamp_us;
    }
    return message;
}

/* Takes up to one frame: a burst of frames takes as many steps, so that no frame hides another. The number of bytes is
 * limited, so that a flood of bytes does not keep the loop from its watchdog. */
static host_message receive(board *self, uint32_t *stamp_us)
{
    uint8_t byte;
    for (int taken = 0; taken < RECEIVE_MAX && hal_read_byte(&byte); taken++) {
        frame received;
        const decoded what = frame_decode(&self->decoder, byte, &received);
        if (what == DECODED_FRAME)
            return understand(self, &received, stamp_us);
        if (what == DECODED_BAD)
            return (host_message){.event = EVENT_BAD_FRAME};
    }
    return (host_message){.event = EVENT_NONE};
}

static void report(board *self, const safety_inputs *inputs, const safety_outputs *outputs)
{
    telemetry ours = {
        .state = outputs->state,
        .holder = outputs->holder,
        .faults = outputs->faults,
        .reference_mv = inputs->reference_mv,
        .echo_sequence = self->echo_sequence,
        .echo_stamp_us = self->echo_stamp_us,
        .board_ms = self->core.now_ms,
        .bad_frames = self->bad_frames,
        .rejected = self->rejected,
        .guard_bits = outputs->guard_bits,
    };
    memcpy(ours.set_mv, outputs->line_mv, sizeof ours.set_mv);
    memcpy(ours.line_mv, inputs->line_mv, sizeof ours.line_mv);
    memcpy(ours.joystick_mv, inputs->joystick_mv, sizeof ours.joystick_mv);
    memcpy(ours.caps, outputs->caps, sizeof ours.caps);
    frame message;
    protocol_write_telemetry(&ours, &message);
    send(self, &message);
    self->telemetry_ms = self->core.now_ms;
}

static void count(board *self, const host_message *host, const safety_outputs *outputs, uint32_t stamp_us)
{
    if (host->event == EVENT_BAD_FRAME)
        self->bad_frames++;
    if ((host->event == EVENT_COMMAND || host->event == EVENT_LIMIT) && !outputs->heard)
        self->rejected++;
    if (outputs->heard) {
        self->echo_sequence = host->sequence;
        self->echo_stamp_us = stamp_us;
    }
}

/* The converter changes only while it is off the lines, or to the voltages intended for the lines. */
static void act(board *self, const safety_outputs *outputs)
{
    if (outputs->holder != HOLDER_BOARD)
        hal_switch(outputs->holder);
    self->converter_ok = hal_put(outputs->line_mv);
    if (outputs->holder == HOLDER_BOARD)
        hal_switch(outputs->holder);
}

safety_outputs board_step(board *self)
{
    safety_inputs inputs = {0};
    uint32_t stamp_us = 0;
    hal_sense(&inputs);
    inputs.board_ok = inputs.board_ok && self->converter_ok;
    inputs.host = receive(self, &stamp_us);
    const safety_outputs outputs = safety_step(&self->core, &inputs, hal_now_ms());
    act(self, &outputs);
    count(self, &inputs.host, &outputs, stamp_us);
    if (outputs.heard || self->core.now_ms - self->telemetry_ms >= TELEMETRY_MS)
        report(self, &inputs, &outputs);
    if (outputs.kick)
        hal_kick();
    return outputs;
}
