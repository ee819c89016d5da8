// Error register, error history and emergency messages (CiA 301, 7.2.7, 0x1001, 0x1003, 0x1014,
// 0x1015).
#ifndef ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_EMCY_H_
#define ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_EMCY_H_

#include <array>
#include <cstddef>
#include <cstdint>

#include "firmware/canopen/protocol/can_port.h"
#include "firmware/canopen/protocol/object_dictionary.h"

namespace armtrue::canopen {

// Error conditions. Each is either present or not; raising it twice reports it once.
enum class Condition : std::uint8_t {
  kJointInputStale,  // targets missing, late or incomplete: output stopped
  kTableRefused,     // an image did not pass verification
  kInputSilent,      // a temperature fell silent, or an input of the table was never written
  kTargetBySdo,      // a drive was given a target that the compensator does not correct
  kTargetConflict,   // contradicting targets: a second controller, or SYNC lost
  kStorage,          // a slot or the parameter memory failed
  kHeartbeatLost,    // a watched node fell silent
  kReceiveOverrun,   // frames lost in the controller
  kBusPassive,       // error passive
  kBusOffUpstream,   // recovered from bus-off; the message leaves after the recovery
  kBusOffDownstream,
  kPdoLength,         // a PDO shorter than its mapping
  kSyncLength,        // SYNC with an unexpected counter, or without an expected one
  kSetsWithheld,      // targets come, and no set of them goes out
  kReferenceChanged,  // an actual position jumped at rest: the encoder's zero was changed
  kOffsetDiffers,     // a drive reports another offset than those sent to it
  kInputRange,        // a PDO carries a value outside the object's bounds
  kCount,
};

class Emcy {
 public:
  explicit Emcy(ObjectDictionary& dictionary) : dictionary_(dictionary) {}

  // Forgets conditions, history and unsent messages (NMT reset).
  void reset();

  // Reports a condition: error register, history, message. `information` goes into the
  // manufacturer-specific bytes of the message. `source`, below 16: origin of a condition that can
  // have several (a sensor, a watched node, a bus); each is reported once.
  void raise(Condition condition, std::uint32_t information, std::size_t source = 0);

  // Ends the condition for `source`. With its last source the condition is over: the error register
  // is updated, and "error reset" with its code (in the manufacturer-specific bytes) is queued.
  void clear(Condition condition, std::size_t source = 0);

  // Sends queued messages, one per inhibit time. Call only in NMT states that allow EMCY
  // (pre-operational, operational).
  void process(CanPort& port, std::uint64_t now_us);

  // 0x1003 sub 0 was set to zero.
  void clear_history();

 private:
  struct Message {
    std::uint16_t code = 0;
    std::uint8_t error_register = 0;
    std::uint32_t information = 0;
  };
  static constexpr std::size_t kConditions = static_cast<std::size_t>(Condition::kCount);

  void update_register();
  void queue(const Message& message);

  ObjectDictionary& dictionary_;
  std::array<std::uint16_t, kConditions> raised_ = {};  // one bit per source
  std::array<Message, 16> queue_ = {};
  std::size_t queue_begin_ = 0;
  std::size_t queue_size_ = 0;
  std::uint64_t next_allowed_us_ = 0;
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_EMCY_H_
