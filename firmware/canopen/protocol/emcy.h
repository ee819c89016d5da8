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

// What can be wrong. Each condition is either present or not; raising it twice reports it once.
enum class Condition : std::uint8_t {
  kJointInputStale,  // targets missing, late or incomplete: output stopped
  kTableRefused,     // an image did not pass verification
  kInputSilent,      // a temperature went silent, or what the table reads was never given
  kTargetBySdo,      // a drive was given a target that the compensator does not correct
  kTargetConflict,   // contradicting targets: a second controller, or SYNC lost
  kStorage,          // a slot or the parameter memory failed
  kHeartbeatLost,    // a watched node fell silent
  kReceiveOverrun,   // frames lost in the controller
  kBusPassive,       // error passive
  kBusOffUpstream,   // recovered from bus-off; the message leaves after the recovery
  kBusOffDownstream,
  kPdoLength,         // a PDO shorter than its mapping
  kSyncLength,        // SYNC with a counter that is not expected, or without one that is
  kSetsWithheld,      // targets come, and no set of them goes out
  kReferenceChanged,  // an actual position jumped at rest: a drive counts from another zero
  kOffsetDiffers,     // a drive says that it has another offset than it was sent
  kInputRange,        // a PDO carries a value outside the object's bounds
  kCount,
};

class Emcy {
 public:
  explicit Emcy(ObjectDictionary& dictionary) : dictionary_(dictionary) {}

  // Forgets conditions, history and unsent messages (NMT reset).
  void reset();

  // Reports a condition: error register, history, message. `information` goes into the
  // manufacturer's bytes of the message. `source`, below 16: whose it is where several can have it
  // (a sensor, a watched node, a bus); each is reported once.
  void raise(Condition condition, std::uint32_t information, std::size_t source = 0);

  // The source is well. With the last one the condition has gone: the register follows, and the
  // message "error reset" with the code of what went (in its manufacturer bytes) leaves.
  void clear(Condition condition, std::size_t source = 0);

  // Sends what waits, one message each inhibit time. Call where EMCY is allowed (pre-operational,
  // operational).
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
  std::array<std::uint16_t, kConditions> raised_ = {};  // a bit a source
  std::array<Message, 16> queue_ = {};
  std::size_t queue_begin_ = 0;
  std::size_t queue_size_ = 0;
  std::uint64_t next_allowed_us_ = 0;
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_EMCY_H_
