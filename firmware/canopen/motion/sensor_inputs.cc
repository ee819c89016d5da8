#include "firmware/canopen/motion/sensor_inputs.h"

#include "firmware/core/fixed/fixed.h"

namespace armtrue::canopen {
namespace {

// Values below absolute zero, and 0x7FFF, indicate a broken sensor. [0.01 °C]
bool can_be(std::int16_t temperature) { return temperature >= -27315 && temperature != INT16_MAX; }

}  // namespace

void SensorInputs::note(std::uint16_t index, std::uint8_t sub, std::uint64_t now_us) {
  const bool is_temperature =
      index == od::kTemperatureInputs[0].index && sub > 0 && sub <= kMaxSensors;
  if (!is_temperature && index != od::kPayloadMass.index) return;
  const std::size_t input = is_temperature ? sub - 1U : kPayload;
  broken_ &= ~(1U << input);
  if (is_temperature && !can_be(dictionary_.get(od::kTemperatureInputs[input]))) {
    broken_ |= 1U << input;
    return;
  }
  silent_since_us_[input] = now_us;
  given_ |= 1U << input;
  emcy_.clear(Condition::kInputSilent, input);
}

void SensorInputs::take(const Pdo& pdo, const CanFrame& frame, std::uint64_t now_us) {
  const Applied applied = apply_rpdo(dictionary_, pdo, frame);
  if (applied.beyond != 0) {
    emcy_.raise(Condition::kInputRange, applied.beyond);
  } else if (applied.has_bounds) {
    emcy_.clear(Condition::kInputRange);
  }
  for (std::size_t k = 0; k < pdo.mapping.count; ++k) {
    const MappedEntry& mapped = pdo.mapping.entries[k];
    if ((applied.refused >> k & 1U) == 0) note(mapped.index, mapped.sub, now_us);
  }
}

void SensorInputs::read(CycleInput& input) const {
  for (std::size_t sensor = 0; sensor < kMaxSensors; ++sensor) {
    // 0x2020 counts in 0.01 °C.
    input.temperature_mdegc[sensor] = dictionary_.get(od::kTemperatureInputs[sensor]) * 10;
  }
  input.temperature_valid = given_ & ~broken_;
  input.payload_g = saturate(std::int64_t{dictionary_.get(od::kPayloadMass)});
}

void SensorInputs::watch(std::uint32_t needed, std::uint64_t now_us) {
  const std::uint64_t limit_us =
      dictionary_.get(od::compensator_control::kTemperatureTimeOut) * std::uint64_t{1000};
  for (std::size_t input = 0; input < silent_since_us_.size(); ++input) {
    const std::uint32_t bit = 1U << input;
    const bool given = (given_ & bit) != 0;
    if (given ? input == kPayload : (needed & bit) == 0) silent_since_us_[input] = now_us;
    if (now_us - silent_since_us_[input] <= limit_us) continue;
    given_ &= ~bit;
    const std::size_t number = input == kPayload ? 0 : input + 1;
    emcy_.raise(Condition::kInputSilent, static_cast<std::uint32_t>(number), input);
  }
}

}  // namespace armtrue::canopen
