#include "firmware/canopen/protocol/emcy.h"

#include <algorithm>

#include "firmware/canopen/protocol/cob_id.h"

namespace armtrue::canopen {
namespace {

struct ConditionCode {
  std::uint16_t code;          // CiA 301, table 27; 0xFFxx device specific
  std::uint8_t register_bits;  // CiA 301, table 46
};

constexpr std::uint8_t kGeneric = 1U << 0;
constexpr std::uint8_t kCommunication = 1U << 4;
constexpr std::uint8_t kDeviceSpecific = 1U << 5;

constexpr ConditionCode kCodes[] = {
    {0xFF10, kGeneric | kCommunication},   // kJointInputStale
    {0xFF11, kGeneric | kDeviceSpecific},  // kTableRefused
    {0xFF12, kGeneric | kDeviceSpecific},  // kInputSilent
    {0xFF13, kGeneric | kDeviceSpecific},  // kTargetBySdo
    {0xFF14, kGeneric | kCommunication},   // kTargetConflict
    {0x5530, kGeneric | kDeviceSpecific},  // kStorage: device hardware, EEPROM
    {0x8130, kGeneric | kCommunication},   // kHeartbeatLost
    {0x8110, kGeneric | kCommunication},   // kReceiveOverrun
    {0x8120, kGeneric | kCommunication},   // kBusPassive
    {0x8140, kGeneric | kCommunication},   // kBusOffUpstream
    {0x8140, kGeneric | kCommunication},   // kBusOffDownstream
    {0x8210, kGeneric | kCommunication},   // kPdoLength
    {0x8240, kGeneric | kCommunication},   // kSyncLength
    {0xFF15, kGeneric | kCommunication},   // kSetsWithheld
    {0xFF16, kGeneric | kDeviceSpecific},  // kReferenceChanged
    {0xFF17, kGeneric | kDeviceSpecific},  // kOffsetDiffers
    {0xFF18, kGeneric | kDeviceSpecific},  // kInputRange
};
static_assert(std::size(kCodes) == static_cast<std::size_t>(Condition::kCount));

constexpr std::uint16_t kErrorReset = 0x0000;

}  // namespace

void Emcy::reset() {
  raised_ = {};
  queue_size_ = 0;
  next_allowed_us_ = 0;
  update_register();
  clear_history();
}

void Emcy::clear_history() {
  dictionary_.set(od::kPreDefinedErrorFieldCount, std::uint8_t{0});
  for (std::size_t k = 0; k < std::size(od::kPreDefinedErrorField); ++k) {
    dictionary_.set(od::kPreDefinedErrorField[k], 0U);
  }
}

void Emcy::update_register() {
  std::uint8_t bits = 0;
  for (std::size_t k = 0; k < kConditions; ++k) {
    if (raised_[k] != 0) bits |= kCodes[k].register_bits;
  }
  dictionary_.set(od::kErrorRegister, bits);
}

void Emcy::raise(Condition condition, std::uint32_t information, std::size_t source) {
  const auto number = static_cast<std::size_t>(condition);
  const auto bit = static_cast<std::uint16_t>(1U << source);
  if ((raised_[number] & bit) != 0) return;
  raised_[number] = static_cast<std::uint16_t>(raised_[number] | bit);
  update_register();
  const std::uint16_t code = kCodes[number].code;
  // The newest error is the first entry; the oldest is dropped.
  constexpr std::size_t kFields = std::size(od::kPreDefinedErrorField);
  for (std::size_t k = kFields - 1; k > 0; --k) {
    dictionary_.set(od::kPreDefinedErrorField[k],
                    dictionary_.get(od::kPreDefinedErrorField[k - 1]));
  }
  dictionary_.set(od::kPreDefinedErrorField[0],
                  static_cast<std::uint32_t>(code) | (information & 0xFFFFU) << 16);
  const std::uint8_t count = dictionary_.get(od::kPreDefinedErrorFieldCount);
  dictionary_.set(od::kPreDefinedErrorFieldCount,
                  static_cast<std::uint8_t>(std::min<std::size_t>(count + 1U, kFields)));
  queue({code, dictionary_.get(od::kErrorRegister), information});
}

void Emcy::clear(Condition condition, std::size_t source) {
  const auto number = static_cast<std::size_t>(condition);
  const auto others = static_cast<std::uint16_t>(raised_[number] & ~(1U << source));
  if (others == raised_[number]) return;
  raised_[number] = others;
  if (others != 0) return;
  update_register();
  queue({kErrorReset, dictionary_.get(od::kErrorRegister), kCodes[number].code});
}

void Emcy::queue(const Message& message) {
  if (queue_size_ == queue_.size()) return;  // errors are in the history all the same
  queue_[(queue_begin_ + queue_size_) % queue_.size()] = message;
  ++queue_size_;
}

void Emcy::process(CanPort& port, std::uint64_t now_us) {
  const std::uint32_t cob_id = dictionary_.get(od::kCOBIDEMCY);
  if ((cob_id & kInvalid) != 0) {
    queue_size_ = 0;
    return;
  }
  while (queue_size_ > 0 && now_us >= next_allowed_us_) {
    const Message& message = queue_[queue_begin_];
    CanFrame frame;
    frame.id = cob_id & kIdMask;
    frame.len = 8;
    store_le(&frame.data[0], message.code);
    frame.data[2] = message.error_register;
    store_le(&frame.data[3], message.information);
    if (!port.send(frame)) return;
    queue_begin_ = (queue_begin_ + 1) % queue_.size();
    --queue_size_;
    // 0x1015 counts in 100 µs.
    next_allowed_us_ = now_us + dictionary_.get(od::kInhibitTimeEMCY) * std::uint64_t{100};
  }
}

}  // namespace armtrue::canopen
