// Layout of a slot: thirty-two words, then the table image. State is kept in a journal and not in
// flags, because with pairs of flags two power cuts left slots on which later starts disagree
// (power_cut_test.cc).
//
//   word    meaning                written
//   0       erased mark            after an erase that completed
//   1       begun mark             before the first word of an image
//   2       magic                  after the image has been read back, as are the next four
//   3       layout version
//   4       sequence number
//   5       image length in bytes
//   6       CRC-32 of the image
//   7       stays blank
//   8...31  journal                one word at a time, from the front
//
// A journal entry is a mark (sealed, trial, confirmed, rejected) combined with the CRC-32 of words
// 2 to 6, so that an entry also proves the header that it belongs to. A mark counts as settled when
// the last two entries carry it. A word that lost power while it was programmed can read
// differently each time. A start that finds the journal unsettled takes the last entry that it can
// read and settles it before acting on it, so that every later start decides the same.
//
// Every word is programmed at most once between erases (flash with an error-correcting code allows
// no more).
#ifndef ARMTRUE_FIRMWARE_STORAGE_SLOT_FORMAT_H_
#define ARMTRUE_FIRMWARE_STORAGE_SLOT_FORMAT_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "firmware/storage/flash.h"

namespace armtrue::storage {

inline constexpr std::size_t kHeaderWords = 32;
inline constexpr std::size_t kHeaderBytes = 4 * kHeaderWords;
inline constexpr std::uint32_t kLayoutVersion = 1;

using HeaderWords = std::array<std::uint32_t, kHeaderWords>;

enum HeaderWord : std::size_t {
  kErasedAt = 0,
  kBegunAt = 1,
  kMagicAt = 2,
  kVersionAt = 3,
  kSequenceAt = 4,
  kLengthAt = 5,
  kImageCrcAt = 6,
  kFieldsEnd = 7,
  kJournalAt = 8,
};

inline constexpr std::uint32_t kMagic = 0x4C535441;  // "ATSL"
inline constexpr std::uint32_t kErasedMark = 0x5AA5C33C;
inline constexpr std::uint32_t kBegunMark = 0x3CC35AA5;

// Top bit clear, and at least eight bits between any two.
enum class Mark : std::uint32_t {
  kSealed = 0x0FF06996,
  kTrial = 0x69960FF0,
  kConfirmed = 0x33CC5AA5,
  kRejected = 0x5AA533CC,
};

inline constexpr std::array kAllMarks = {Mark::kSealed, Mark::kTrial, Mark::kConfirmed,
                                         Mark::kRejected};

// CRC-32 of words 2 to 6 with the top bit clear: no journal entry is a blank word.
std::uint32_t fields_check(const HeaderWords& words);

// The journal entry for `mark` under a header.
inline std::uint32_t journal_entry(const HeaderWords& words, Mark mark) {
  return static_cast<std::uint32_t>(mark) ^ fields_check(words);
}

struct JournalReading {
  std::optional<Mark> last;  // of the last entry that can be read; none: the header is not sealed
  bool is_settled = false;   // the last two words written both carry it
  std::size_t free_at = kJournalAt;  // where the next entry goes; kHeaderWords: the journal is full
};

JournalReading read_journal(const HeaderWords& words);

}  // namespace armtrue::storage

#endif  // ARMTRUE_FIRMWARE_STORAGE_SLOT_FORMAT_H_
