#include "firmware/storage/slot_store.h"

#include <algorithm>

#include "firmware/core/crypto/crc32.h"

namespace armtrue::storage {
namespace {

constexpr std::size_t kScanBytes = 64;  // block in which a slot is checked for blankness

std::uint32_t word_at(std::span<const std::uint8_t> bytes, std::size_t offset) {
  std::uint32_t word = kBlankWord;
  for (std::size_t i = 0; i < 4 && offset + i < bytes.size(); ++i) {
    word &= ~(0xFFU << (8 * i));
    word |= static_cast<std::uint32_t>(bytes[offset + i]) << (8 * i);
  }
  return word;
}

// Programming clears bits one by one, erasing sets them, so that a word between blank and `mark`
// has every bit of `mark` set.
bool could_be_partial(std::uint32_t word, std::uint32_t mark) { return (word & mark) == mark; }

}  // namespace

HeaderWords SlotStore::read_header(std::size_t slot) const {
  std::array<std::uint8_t, kHeaderBytes> bytes;
  flash_.read(slot, 0, bytes);
  HeaderWords words;
  for (std::size_t i = 0; i < kHeaderWords; ++i) words[i] = word_at(bytes, 4 * i);
  return words;
}

bool SlotStore::is_blank(std::size_t slot, std::size_t from_byte) const {
  std::array<std::uint8_t, kScanBytes> block;
  for (std::size_t offset = from_byte; offset < flash_.slot_size(); offset += block.size()) {
    const std::size_t size = std::min(block.size(), flash_.slot_size() - offset);
    const std::span<std::uint8_t> part(block.data(), size);
    flash_.read(slot, offset, part);
    for (const std::uint8_t byte : part) {  // std::all_of is unrolled by four: 80 bytes more
      if (byte != 0xFF) return false;
    }
  }
  return true;
}

bool SlotStore::program(std::size_t slot, std::size_t word_index, std::uint32_t word) {
  const bool accepted = flash_.program(slot, 4 * word_index, word);
  std::array<std::uint8_t, 4> bytes;
  flash_.read(slot, 4 * word_index, bytes);
  return accepted && word_at(bytes, 0) == word;
}

// Entries that do not read back are skipped: the mark is settled when two in a row do.
bool SlotStore::append(std::size_t slot, Mark mark) {
  const HeaderWords words = read_header(slot);
  const std::uint32_t entry = journal_entry(words, mark);
  std::size_t in_a_row = 0;
  for (std::size_t i = read_journal(words).free_at; i < kHeaderWords; ++i) {
    in_a_row = program(slot, i, entry) ? in_a_row + 1 : 0;
    if (in_a_row == 2) return true;
  }
  return false;
}

bool SlotStore::erase(std::size_t slot) {
  status_.slot[slot] = {SlotState::kTorn, 0, 0};
  if (!flash_.erase(slot) || !is_blank(slot, 0) || !program(slot, kErasedAt, kErasedMark)) {
    return false;
  }
  status_.slot[slot] = {SlotState::kBlank, 0, 0};
  return true;
}

// A slot that reads as blank but lacks the erased mark may come from an erase that lost power half
// way; its cells may be unstable.
bool SlotStore::make_erased(std::size_t slot) {
  if (read_header(slot)[kErasedAt] == kErasedMark && is_blank(slot, 4 * kBegunAt)) return true;
  return erase(slot);
}

bool SlotStore::program_image(std::size_t slot, std::span<const std::uint8_t> image) {
  if (!program(slot, kBegunAt, kBegunMark)) return false;
  for (std::size_t offset = 0; offset < image.size(); offset += 4) {
    const std::uint32_t word = word_at(image, offset);
    if (word != kBlankWord && !program(slot, kHeaderWords + offset / 4, word)) return false;
  }
  return true;
}

bool SlotStore::program_header(std::size_t slot, std::span<const std::uint8_t> image,
                               std::uint32_t sequence) {
  HeaderWords words{};
  words[kMagicAt] = kMagic;
  words[kVersionAt] = kLayoutVersion;
  words[kSequenceAt] = sequence;
  words[kLengthAt] = static_cast<std::uint32_t>(image.size());
  words[kImageCrcAt] = crc32(image);
  for (std::size_t i = kMagicAt; i < kFieldsEnd; ++i) {
    if (!program(slot, i, words[i])) return false;
  }
  return append(slot, Mark::kSealed);
}

std::span<const std::uint8_t> SlotStore::load(std::size_t slot,
                                              std::span<std::uint8_t> buffer) const {
  const std::size_t length = status_.slot[slot].length;
  if (length == 0 || length > buffer.size() || length > capacity()) return {};
  const std::span<std::uint8_t> image = buffer.first(length);
  flash_.read(slot, kHeaderBytes, image);
  if (crc32(image) != image_crc_[slot]) return {};
  return image;
}

SlotState SlotStore::classify_unsealed(std::size_t slot, const HeaderWords& words) const {
  const bool ours = could_be_partial(words[kErasedAt], kErasedMark) &&
                    could_be_partial(words[kBegunAt], kBegunMark) &&
                    could_be_partial(words[kMagicAt], kMagic);
  if (!ours) return SlotState::kForeign;
  return is_blank(slot, 4 * kBegunAt) ? SlotState::kBlank : SlotState::kTorn;
}

SlotState SlotStore::settle(std::size_t slot, const JournalReading& journal) {
  if (*journal.last == Mark::kTrial) {
    append(slot, Mark::kRejected);
    return SlotState::kRejected;
  }
  if (!journal.is_settled && !append(slot, *journal.last)) return SlotState::kTorn;
  switch (*journal.last) {
    case Mark::kSealed:
      return SlotState::kPending;
    case Mark::kConfirmed:
      return SlotState::kConfirmed;
    case Mark::kTrial:
    case Mark::kRejected:
      break;
  }
  return SlotState::kRejected;
}

SlotStatus SlotStore::classify(std::size_t slot, std::span<std::uint8_t> buffer) {
  const HeaderWords words = read_header(slot);
  const JournalReading journal = read_journal(words);
  if (words[kMagicAt] != kMagic || !journal.last) {
    return {classify_unsealed(slot, words), 0, 0};
  }
  SlotStatus status{SlotState::kNewer, words[kSequenceAt], words[kLengthAt]};
  if (words[kVersionAt] > kLayoutVersion) return status;

  image_crc_[slot] = words[kImageCrcAt];
  status_.slot[slot] = status;
  const std::span<const std::uint8_t> image = load(slot, buffer);
  if (image.empty()) {
    status.state = SlotState::kTorn;
    return status;
  }
  switch (verifier_.verify(image)) {
    case TableVerdict::kAccepted:
      status.state = settle(slot, journal);
      break;
    case TableVerdict::kForeign:
      status.state = SlotState::kForeign;
      break;
    case TableVerdict::kNewer:
      status.state = SlotState::kNewer;
      break;
    case TableVerdict::kRefused:
      status.state = SlotState::kRefused;
      break;
  }
  return status;
}

std::optional<std::size_t> SlotStore::slot_in(SlotState state) const {
  for (std::size_t slot = 0; slot < kSlots; ++slot) {
    if (status_.slot[slot].state == state) return slot;
  }
  return std::nullopt;
}

std::optional<std::size_t> SlotStore::newest_confirmed() const {
  std::optional<std::size_t> newest;
  for (std::size_t slot = 0; slot < kSlots; ++slot) {
    const SlotStatus& status = status_.slot[slot];
    if (status.state != SlotState::kConfirmed) continue;
    if (!newest || status.sequence > status_.slot[*newest].sequence) newest = slot;
  }
  return newest;
}

// The slot that the next commit overwrites: the one that is not active. Without an active table,
// the pending one, or else the one with the less valuable content.
std::size_t SlotStore::spare() const {
  if (status_.active) return 1 - *status_.active;
  if (const std::optional<std::size_t> pending = slot_in(SlotState::kPending)) return *pending;
  const auto worth = [this](std::size_t slot) {
    switch (status_.slot[slot].state) {
      case SlotState::kBlank:
        return 0;
      case SlotState::kTorn:
      case SlotState::kRejected:
        return 1;
      case SlotState::kRefused:
      case SlotState::kForeign:
        return 2;
      case SlotState::kNewer:
      case SlotState::kPending:
      case SlotState::kTrial:
      case SlotState::kConfirmed:
        return 3;
    }
    return 3;
  };
  return worth(1) < worth(0) ? 1 : 0;
}

std::span<const std::uint8_t> SlotStore::start(std::span<std::uint8_t> buffer) {
  for (std::size_t slot = 0; slot < kSlots; ++slot) status_.slot[slot] = classify(slot, buffer);
  status_.active = newest_confirmed();
  return load_active(buffer);
}

std::span<const std::uint8_t> SlotStore::load_active(std::span<std::uint8_t> buffer) {
  while (status_.active) {
    const std::size_t slot = *status_.active;
    const std::span<const std::uint8_t> image = load(slot, buffer);
    if (!image.empty() && verifier_.verify(image) == TableVerdict::kAccepted) return image;
    status_.slot[slot].state = SlotState::kTorn;
    status_.active = newest_confirmed();
  }
  return {};
}

bool SlotStore::has_lost_newest() const {
  const std::uint32_t active = status_.active ? status_.slot[*status_.active].sequence : 0;
  return std::ranges::any_of(status_.slot, [active](const SlotStatus& slot) {
    return slot.state == SlotState::kTorn && slot.sequence > active;
  });
}

StoreResult SlotStore::commit(std::span<const std::uint8_t> image) {
  if (slot_in(SlotState::kTrial)) return StoreResult::kTrialRunning;
  if (image.empty() || image.size() > capacity()) return StoreResult::kTooLarge;
  if (verifier_.verify(image) != TableVerdict::kAccepted) return StoreResult::kTableRefused;
  std::uint32_t newest = 0;
  for (const SlotStatus& status : status_.slot) newest = std::max(newest, status.sequence);
  if (newest == UINT32_MAX) return StoreResult::kSequenceExhausted;

  const std::size_t slot = spare();
  if (!make_erased(slot)) return StoreResult::kEraseFailed;
  status_.slot[slot] = {SlotState::kTorn, 0, 0};
  const std::uint32_t sequence = newest + 1;
  if (!program_image(slot, image) || !program_header(slot, image, sequence)) {
    return StoreResult::kProgramFailed;
  }
  image_crc_[slot] = crc32(image);
  status_.slot[slot] = {SlotState::kPending, sequence, static_cast<std::uint32_t>(image.size())};
  return StoreResult::kDone;
}

StoreResult SlotStore::load_pending(std::span<std::uint8_t> buffer,
                                    std::span<const std::uint8_t>& image) {
  const std::optional<std::size_t> slot = slot_in(SlotState::kPending);
  if (!slot) return StoreResult::kNothingPending;
  if (status_.slot[*slot].length > buffer.size()) return StoreResult::kTooLarge;
  const std::span<const std::uint8_t> loaded = load(*slot, buffer);
  if (loaded.empty()) return StoreResult::kImageChanged;
  if (verifier_.verify(loaded) != TableVerdict::kAccepted) return StoreResult::kTableRefused;
  image = loaded;
  return StoreResult::kDone;
}

StoreResult SlotStore::begin_trial() {
  const std::optional<std::size_t> slot = slot_in(SlotState::kPending);
  if (!slot) return StoreResult::kNothingPending;
  if (!append(*slot, Mark::kTrial)) return StoreResult::kProgramFailed;
  status_.slot[*slot].state = SlotState::kTrial;
  status_.active = slot;
  return StoreResult::kDone;
}

StoreResult SlotStore::activate(std::span<std::uint8_t> buffer,
                                std::span<const std::uint8_t>& image) {
  const StoreResult loaded = load_pending(buffer, image);
  return loaded == StoreResult::kDone ? begin_trial() : loaded;
}

StoreResult SlotStore::confirm() {
  const std::optional<std::size_t> slot = slot_in(SlotState::kTrial);
  if (!slot) return StoreResult::kNoTrial;
  if (!append(*slot, Mark::kConfirmed)) return StoreResult::kProgramFailed;
  status_.slot[*slot].state = SlotState::kConfirmed;
  return StoreResult::kDone;
}

// A mark that cannot be written does no harm: the next start rejects a trial without a confirm mark
// all the same.
StoreResult SlotStore::revert() {
  std::optional<std::size_t> slot = slot_in(SlotState::kTrial);
  if (!slot) slot = slot_in(SlotState::kPending);
  if (!slot) return StoreResult::kNoTrial;
  const bool marked = append(*slot, Mark::kRejected);
  status_.slot[*slot].state = SlotState::kRejected;
  status_.active = newest_confirmed();
  return marked ? StoreResult::kDone : StoreResult::kProgramFailed;
}

}  // namespace armtrue::storage
