// Saved parameters (0x1010) in their own pair of flash slots: a save that is interrupted keeps the
// old block.
#ifndef ARMTRUE_FIRMWARE_PORTS_COMMON_SLOT_PARAMETERS_H_
#define ARMTRUE_FIRMWARE_PORTS_COMMON_SLOT_PARAMETERS_H_

#include <array>
#include <cstdint>
#include <span>

#include "firmware/canopen/node/parameter_store.h"
#include "firmware/storage/flash.h"
#include "firmware/storage/slot_store.h"

namespace armtrue::ports {

class SlotParameters final : public canopen::ParameterStore {
 public:
  explicit SlotParameters(storage::Flash& flash) : store_(flash, verifier_) {}

  // Reads the slots. Call once, before anything else.
  void start() { saved_ = store_.start(block_); }

  // Whether the parameters saved last can no longer be read. load() then fails: the older ones in
  // the other slot are not the ones that were requested.
  bool is_damaged() const { return store_.has_lost_newest(); }

  bool load(std::span<std::uint8_t> block) override;
  bool holds_something() const override;
  // A save that fails keeps the parameters saved before.
  bool save(std::span<const std::uint8_t> block) override;
  // Saves a one-byte marker: load() treats a block of another length as nothing saved.
  bool erase() override;

 private:
  // The block carries its own checksum and layout; the slots' CRC is enough here.
  struct AcceptAll final : storage::TableVerifier {
    storage::TableVerdict verify(std::span<const std::uint8_t>) const override {
      return storage::TableVerdict::kAccepted;
    }
  };

  AcceptAll verifier_;
  storage::SlotStore store_;
  std::array<std::uint8_t, canopen::kParameterBlockSize> block_ = {};
  std::span<const std::uint8_t> saved_;
};

}  // namespace armtrue::ports

#endif  // ARMTRUE_FIRMWARE_PORTS_COMMON_SLOT_PARAMETERS_H_
