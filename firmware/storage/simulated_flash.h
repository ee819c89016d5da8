// Two slots of flash in memory that lose power, fail and wear as real flash does. For tests.
#ifndef ARMTRUE_FIRMWARE_STORAGE_SIMULATED_FLASH_H_
#define ARMTRUE_FIRMWARE_STORAGE_SIMULATED_FLASH_H_

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <random>
#include <span>
#include <stdexcept>
#include <vector>

#include "firmware/storage/flash.h"

namespace armtrue::storage {

// Thrown in the middle of a flash operation: the rest of the program does not happen.
struct PowerCut : std::exception {};

// Progress of the operation that the power cut interrupts.
enum class CutKind : std::uint8_t {
  kBefore,       // nothing has happened yet
  kBarelyBegun,  // one bit is half way, and reads at random; the others are unchanged
  kTorn,         // some bits have changed, and are stable
  kUnstable,     // some bits are half way, and read at random
  kNearlyDone,   // one bit is half way; the rest has changed
  kAfter,        // complete, but not reported
};

inline constexpr std::array kAllCutKinds = {CutKind::kBefore,     CutKind::kBarelyBegun,
                                            CutKind::kTorn,       CutKind::kUnstable,
                                            CutKind::kNearlyDone, CutKind::kAfter};

class SimulatedFlash : public Flash {
 public:
  static constexpr std::size_t kNever = std::numeric_limits<std::size_t>::max();

  SimulatedFlash(std::size_t slot_size, std::uint32_t seed) : random_(seed) {
    for (Slot& slot : slots_) {
      slot.word.assign(slot_size / 4, kBlankWord);
      slot.unstable.assign(slot_size / 4, 0);
    }
  }

  std::size_t slot_size() const override { return 4 * slots_[0].word.size(); }

  void read(std::size_t slot, std::size_t offset, std::span<std::uint8_t> data) const override {
    if (offset + data.size() > slot_size()) throw std::out_of_range("read beyond the slot");
    for (std::size_t i = 0; i < data.size(); ++i) {
      const std::size_t at = (offset + i) / 4;
      const std::uint32_t unstable = slots_[slot].unstable[at];
      const std::uint32_t noise = unstable == 0 ? 0 : unstable & draw();
      data[i] =
          static_cast<std::uint8_t>((slots_[slot].word[at] ^ noise) >> (8 * ((offset + i) % 4)));
    }
  }

  bool program(std::size_t slot, std::size_t offset, std::uint32_t word) override {
    if (offset % 4 != 0 || offset + 4 > slot_size())
      throw std::out_of_range("program beyond the slot");
    if (is_protected_) return false;
    std::uint32_t& cell = slots_[slot].word[offset / 4];
    std::uint32_t& unstable = slots_[slot].unstable[offset / 4];
    const std::uint32_t target = cell & word;
    if (cell != kBlankWord) ++reprogrammed_;
    if (operation_ == cut_at_) {
      change_partly(cell, unstable, target, cut_kind_);
      throw PowerCut();
    }
    ++operation_;
    if (operation_ - 1 == fail_at_) {
      change_partly(cell, unstable, target, CutKind::kTorn);
      return false;
    }
    change_partly(cell, unstable, target, CutKind::kAfter);
    return true;
  }

  bool erase(std::size_t slot) override {
    if (operation_ == cut_at_) {
      erase_partly(slot, cut_kind_);
      throw PowerCut();
    }
    ++operation_;
    if (operation_ - 1 == fail_at_) {
      erase_partly(slot, CutKind::kTorn);
      return false;
    }
    erase_partly(slot, CutKind::kAfter);
    ++erases_;
    return true;
  }

  // Power is lost in the operation with this number, counted from now; kNever: in none.
  void cut_at(std::size_t operation, CutKind kind) {
    operation_ = 0;
    cut_at_ = operation;
    cut_kind_ = kind;
  }

  // The operation with this number, counted from now, reports an error and is left half done.
  void fail_at(std::size_t operation) {
    operation_ = 0;
    fail_at_ = operation;
  }

  // While protected, programming is refused and every word keeps its value.
  void protect(bool is_protected) { is_protected_ = is_protected; }

  void run_undisturbed() {
    cut_at(kNever, CutKind::kBefore);
    fail_at(kNever);
  }

  std::size_t operations() const { return operation_; }
  std::size_t erases() const { return erases_; }

  // Programmings of a word that was not blank: flash with an error-correcting code refuses them.
  std::size_t reprogrammed() const { return reprogrammed_; }

  // For content that no store wrote: of another origin, or with a decayed bit.
  std::uint32_t& word(std::size_t slot, std::size_t index) { return slots_[slot].word[index]; }

 private:
  struct Slot {
    std::vector<std::uint32_t> word;
    std::vector<std::uint32_t> unstable;  // bits of `word` that read at random
  };

  std::uint32_t draw() const { return static_cast<std::uint32_t>(random_()); }

  std::uint32_t one_bit_of(std::uint32_t mask) const {
    std::uint32_t bit = 1U << draw() % 32;
    while (mask != 0 && (bit & mask) == 0) bit = std::rotl(bit, 1);
    return bit & mask;
  }

  // Changes a word partly towards `target`. Bits that have reached it are stable.
  void change_partly(std::uint32_t& word, std::uint32_t& unstable, std::uint32_t target,
                     CutKind kind) const {
    const std::uint32_t changing = word ^ target;
    const std::uint32_t half_way = kind == CutKind::kUnstable ? changing & draw()
                                   : kind == CutKind::kBarelyBegun || kind == CutKind::kNearlyDone
                                       ? one_bit_of(changing)
                                       : 0;
    const std::uint32_t arrived = kind == CutKind::kAfter        ? ~0U
                                  : kind == CutKind::kNearlyDone ? ~half_way
                                  : kind == CutKind::kTorn       ? draw()
                                                                 : 0;
    word ^= changing & arrived;
    unstable = (unstable & ~arrived) | half_way;
  }

  void erase_partly(std::size_t slot, CutKind kind) {
    Slot& cells = slots_[slot];
    // An erase that has only just begun, or has nearly ended, is as likely as one half way.
    const std::uint32_t share = draw() % 101;
    for (std::size_t i = 0; i < cells.word.size(); ++i) {
      const bool with_the_rest = kind == CutKind::kAfter || draw() % 100 < share;
      const CutKind part = with_the_rest                  ? kind
                           : kind == CutKind::kNearlyDone ? CutKind::kAfter
                                                          : CutKind::kBefore;
      change_partly(cells.word[i], cells.unstable[i], kBlankWord, part);
    }
  }

  std::array<Slot, kSlots> slots_;
  mutable std::mt19937 random_;
  std::size_t operation_ = 0;
  std::size_t erases_ = 0;
  std::size_t reprogrammed_ = 0;
  std::size_t cut_at_ = kNever;
  std::size_t fail_at_ = kNever;
  bool is_protected_ = false;
  CutKind cut_kind_ = CutKind::kBefore;
};

}  // namespace armtrue::storage

#endif  // ARMTRUE_FIRMWARE_STORAGE_SIMULATED_FLASH_H_
