/* What the tests need beside the firmware's own functions: how large its structures are. */
#include <stddef.h>

#include "frame.h"
#include "safety_core.h"

size_t rig_core_size(void);
size_t rig_decoder_size(void);

size_t rig_core_size(void)
{
    return sizeof(safety_core);
}

size_t rig_decoder_size(void)
{
    return sizeof(frame_decoder);
}
