#include "firmware/ports/common/slot_parameters.h"

#include <algorithm>

namespace armtrue::ports {

bool SlotParameters::load(std::span<std::uint8_t> block) {
  if (is_damaged() || saved_.size() != block.size()) return false;
  std::ranges::copy(saved_, block.begin());
  return true;
}

bool SlotParameters::holds_something() const {
  return is_damaged() || saved_.size() > 1;  // one byte is the marker of erase()
}

bool SlotParameters::save(std::span<const std::uint8_t> block) {
  if (store_.commit(block) == storage::StoreResult::kDone &&
      store_.activate(block_, saved_) == storage::StoreResult::kDone &&
      store_.confirm() == storage::StoreResult::kDone)
    return true;
  // Ends the trial: nothing confirms it later, and during a trial every save is refused.
  store_.revert();
  saved_ = store_.load_active(block_);
  return false;
}

bool SlotParameters::erase() {
  static constexpr std::array<std::uint8_t, 1> kNothing = {0};
  return save(kNothing);
}

}  // namespace armtrue::ports
