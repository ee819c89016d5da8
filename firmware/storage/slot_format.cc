#include "firmware/storage/slot_format.h"

#include "firmware/core/crypto/crc32.h"

namespace armtrue::storage {

std::uint32_t fields_check(const HeaderWords& words) {
  std::array<std::uint8_t, 4 * (kFieldsEnd - kMagicAt)> bytes{};
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    bytes[i] = static_cast<std::uint8_t>(words[kMagicAt + i / 4] >> (8 * (i % 4)));
  }
  return crc32(bytes) & 0x7FFFFFFFU;
}

JournalReading read_journal(const HeaderWords& words) {
  JournalReading reading;
  for (std::size_t i = kJournalAt; i < kHeaderWords; ++i) {
    if (words[i] == kBlankWord) continue;
    reading.is_settled = false;
    reading.free_at = i + 1;
    for (const Mark mark : kAllMarks) {
      if (words[i] != journal_entry(words, mark)) continue;
      reading.is_settled = i > kJournalAt && words[i - 1] == words[i];
      reading.last = mark;
    }
  }
  return reading;
}

}  // namespace armtrue::storage
