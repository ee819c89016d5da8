/* C interface of a complete node on the host, with two queues as its bus and memory as its flash.
 * Independent CANopen clients talk to it from Python, in one process and without losing a frame.
 * For tests. One thread. */
#ifndef ARMTRUE_FIRMWARE_PORTS_HOST_NODE_IN_PROCESS_H_
#define ARMTRUE_FIRMWARE_PORTS_HOST_NODE_IN_PROCESS_H_

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define ARMTRUE_API __attribute__((visibility("default")))

/* A classic data frame with an 11-bit identifier. */
typedef struct {
  uint32_t identifier;
  uint8_t length; /* 0..8 */
  uint8_t unused[3];
  uint8_t data[8];
} armtrue_frame;

typedef struct armtrue_node armtrue_node;

/* A node of six joints in offset mode, in factory state, powered on. The first frame that it sends
 * is its boot-up message. */
ARMTRUE_API armtrue_node* armtrue_node_new(void);
ARMTRUE_API void armtrue_node_free(armtrue_node* node);

ARMTRUE_API uint8_t armtrue_node_id(void);

/* Advances the node's time by `elapsed_us`, gives it a frame (NULL: none) and takes all frames that
 * it sends. Returns their number; those beyond `room` are lost. */
ARMTRUE_API size_t armtrue_node_exchange(armtrue_node* node, const armtrue_frame* request,
                                         uint32_t elapsed_us, armtrue_frame* sent, size_t room);

#ifdef __cplusplus
}
#endif

#endif /* ARMTRUE_FIRMWARE_PORTS_HOST_NODE_IN_PROCESS_H_ */
