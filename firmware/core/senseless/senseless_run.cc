#include "firmware/core/senseless/senseless_run.h"

#include <cmath>
#include <memory>

#include "firmware/core/table/table_cost.h"

namespace armtrue::tests {
namespace {

constexpr std::array<std::uint8_t, 32> kSeed = {3, 1, 4, 1, 5};

// The image with the flag for a signature, the signature and a matching checksum.
Bytes signed_image(const Bytes& plain) {
  Bytes bytes(plain.begin(), plain.end() - 4);
  bytes[format::header::kFlagsAt] |= static_cast<std::uint8_t>(format::kFlagSigned);
  put(bytes, format::header::kImageLengthAt, static_cast<std::uint32_t>(plain.size() + 64));
  const auto signature = sign_ed25519(kSeed, bytes);
  bytes.insert(bytes.end(), signature.begin(), signature.end());
  append(bytes, crc32(bytes));
  return bytes;
}

// Largest correction of a joint and its largest change in a cycle of a millisecond, in increments:
// from the compile-time maxima and the table's own scale.
struct Maxima {
  double delta;
  double step;
};

Maxima maxima_of(const TableView& table, std::size_t joint) {
  const std::uint8_t* at = table.joint(joint);
  const bool slides = table.is_prismatic(joint);
  const double scale = std::abs(std::ldexp(load_i32(at + format::joint::kIncrementPerUnitAt),
                                           -at[format::joint::kIncrementShiftAt]));
  return {(slides ? kMaxDeltaPrismatic : kMaxDeltaRevolute) * scale,
          (slides ? kMaxRatePrismatic : kMaxRateRevolute) * scale * 1e-3};
}

std::string check_cycle(const CycleInput& input, const CycleOutput& output,
                        const CycleOutput& before, const TableView& table) {
  for (std::size_t k = 0; k < table.joint_count(); ++k) {
    const Maxima most = maxima_of(table, k);
    const std::int64_t delta = std::int64_t{output.corrected[k]} - input.target[k];
    if (std::abs(static_cast<double>(delta)) > most.delta + 1.0) return "beyond the clamp";
    if (output.delta[k] != delta) return "a delta that is not the difference";
    // An output that saturates at 32 bits steps there and back, which no rate limits.
    if (((output.flags | before.flags) & kOutputSaturated) != 0) continue;
    const double step = static_cast<double>(delta) - before.delta[k];
    if (std::abs(step) > most.step + 2.0) return "faster than the rate";
  }
  return {};
}

}  // namespace

std::vector<CycleInput> senseless_inputs(SenselessImage& made) {
  std::vector<CycleInput> inputs(kSenselessCycles);
  for (CycleInput& input : inputs) {
    for (std::int32_t& target : input.target) target = made.extreme() / 2;
    for (std::int32_t& temperature : input.temperature_mdegc) temperature = made.extreme();
    input.temperature_valid = static_cast<std::uint32_t>(made.extreme());
    input.payload_g = made.extreme();
    input.time_ms = static_cast<std::uint32_t>(made.extreme());
  }
  inputs.back().target = inputs.front().target;
  for (std::int32_t& target : inputs.back().target) target = made.extreme();
  return inputs;
}

SenselessRun run_senseless(std::uint64_t seed) {
  SenselessRun run;
  SenselessImage made(seed);
  const std::vector<CycleInput> inputs = senseless_inputs(made);
  DeviceIdentity device;
  Bytes image = made.image();
  if (seed % 16 == 0) {
    image = signed_image(image);
    device.has_key = true;
    device.public_key = public_key_ed25519(kSeed);
  }
  const auto compensator =
      std::make_unique<Compensator>(CompensatorConfig{.joint_count = made.joints()});
  const Validation validation = compensator->load(image, device);
  run.accepted = validation.accepted();
  if (!run.accepted) {
    if (validation.field > image.size()) run.wrong = "a refusal that points outside the image";
    return run;
  }
  if (cycle_cost(image) > kCycleBudget) {
    run.wrong = "above the budget";
    return run;
  }
  if (!compensator->activate()) {
    run.wrong = "accepted and not activated";
    return run;
  }
  const TableView table(image);
  CycleOutput before;
  const auto cycle = [&](const CycleInput& input) {
    const CycleOutput output = compensator->cycle(input);
    if (run.wrong.empty()) run.wrong = check_cycle(input, output, before, table);
    for (const std::int32_t delta : output.delta) append(run.outputs, delta);
    append(run.outputs, output.flags);
    before = output;
  };
  for (const CycleInput& input : inputs) cycle(input);
  compensator->disable();
  cycle(inputs.front());
  return run;
}

}  // namespace armtrue::tests
