/* C interface of the firmware's core for the host: Python calls the same code as the devices.
 *
 * Everything is integer, in the firmware's own formats, so that host and device can be compared bit
 * for bit. Arrays are row-major; `joints` is the table's joint count. No call keeps a pointer. */
#ifndef ARMTRUE_FIRMWARE_PORTS_HOST_ARMTRUE_FIXED_H_
#define ARMTRUE_FIRMWARE_PORTS_HOST_ARMTRUE_FIXED_H_

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define ARMTRUE_API __attribute__((visibility("default")))

/* Validates an image as a device would: returns 0 (accepted) or the code of the refusal, and stores
 * the byte offset of the field at fault. `serial`: 24 bytes, or NULL for a device bound to no
 * robot. `joints`: 0 for any. `public_key`: 32 bytes, or NULL for a device without a key. */
ARMTRUE_API int32_t armtrue_validate(const uint8_t* image, size_t length, const char* serial,
                                     uint8_t joints, const uint8_t* public_key, uint32_t* field);

/* Upper bound of the instructions of a control cycle with an accepted image (STM32F405). */
ARMTRUE_API uint32_t armtrue_cycle_cost(const uint8_t* image, size_t length);

/* Largest cycle cost that a device accepts. */
ARMTRUE_API uint32_t armtrue_cycle_budget(void);

/* The refusal's name in English; static storage. */
ARMTRUE_API const char* armtrue_refusal_name(int32_t refusal);

/* Flags of a row, combined with bitwise or. The values are those of armtrue::CycleFlags. */
enum {
  ARMTRUE_MAGNITUDE_CLAMPED = 1,
  ARMTRUE_NEAR_SINGULAR = 4,
  ARMTRUE_OUTSIDE_COVERAGE = 8,
  ARMTRUE_STATE_SATURATED = 16
};

/* State of `rows` poses beside the joint positions. A NULL member stands for its neutral value. */
typedef struct {
  const int32_t* temperature_difference; /* rows × sensors, K · 2^20 */
  const int32_t* payload;                /* rows, kg · 2^20 */
  const int32_t* time;                   /* rows, s · 2^10 */
  const int8_t* direction;               /* rows × joints, -1, 0, +1 */
  const uint8_t* tool;                   /* rows, number of the tool; NULL: the header's */
} armtrue_surroundings;

/* Corrects `rows` poses, each on its own (no blending, no rate limit): delta[row][joint] in 2^-32
 * turn or metre, within the table's magnitude limit. `target`: rows × joints, 2^-32 turn or metre.
 * The image must have been accepted by armtrue_validate. */
ARMTRUE_API void armtrue_solve(const uint8_t* image, size_t length, size_t rows,
                               const int64_t* target, const armtrue_surroundings* surroundings,
                               int32_t* delta, uint16_t* flags);

/* All coordinates of `rows` poses as the term list evaluates them, rows × 68, rad or m · 2^30, with
 * gravity at the pose itself: for tests and for stating quantisation errors. */
ARMTRUE_API void armtrue_coordinates(const uint8_t* image, size_t length, size_t rows,
                                     const int64_t* target,
                                     const armtrue_surroundings* surroundings,
                                     int32_t* coordinates);

/* Ed25519 (RFC 8032). Seeds and keys are 32 bytes, signatures 64. Verify returns 1 for valid. */
ARMTRUE_API void armtrue_ed25519_public_key(const uint8_t* seed, uint8_t* public_key);
ARMTRUE_API void armtrue_ed25519_sign(const uint8_t* seed, const uint8_t* message, size_t length,
                                      uint8_t* signature);
ARMTRUE_API int32_t armtrue_ed25519_verify(const uint8_t* signature, const uint8_t* public_key,
                                           const uint8_t* message, size_t length);

#ifdef __cplusplus
}
#endif

#endif /* ARMTRUE_FIRMWARE_PORTS_HOST_ARMTRUE_FIXED_H_ */
