/* C interface of a whole node on the host, its bus two queues and its flash memory: what CANopen
 * clients that nobody here wrote talk to from Python, in one process and without losing a frame.
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

/* A node of six joints in offset mode, from factory state, powered on; its boot-up message is the
 * first that it sends. */
ARMTRUE_API armtrue_node* armtrue_node_new(void);
ARMTRUE_API void armtrue_node_free(armtrue_node* node);

ARMTRUE_API uint8_t armtrue_node_id(void);

/* Lets `elapsed_us` of the node's time pass, gives it a frame (NULL: none) and takes all that it
 * sends in answer. Returns how many frames that were; those beyond `room` are lost. */
ARMTRUE_API size_t armtrue_node_exchange(armtrue_node* node, const armtrue_frame* request,
                                         uint32_t elapsed_us, armtrue_frame* sent, size_t room);

#ifdef __cplusplus
}
#endif

#endif /* ARMTRUE_FIRMWARE_PORTS_HOST_NODE_IN_PROCESS_H_ */
