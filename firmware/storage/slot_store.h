// Two flash slots for table images: commit, trial, confirm or revert, safe against a power cut at
// any step.
//
// Sequence: the caller stages an image in RAM, `commit` verifies it and writes it into the spare
// slot (header last), `activate` marks the trial and returns the image, `confirm` makes it the
// table of the next start. A start that finds an unconfirmed trial rejects it and returns to the
// confirmed table. After a power cut at any flash operation the active table is the old one, the
// new one or none; an image is only ever returned after its length, CRC and verification have been
// checked in RAM.
#ifndef ARMTRUE_FIRMWARE_STORAGE_SLOT_STORE_H_
#define ARMTRUE_FIRMWARE_STORAGE_SLOT_STORE_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "firmware/storage/flash.h"
#include "firmware/storage/slot_format.h"

namespace armtrue::storage {

// The table reader's verdict on an image; the slot store itself knows nothing of tables.
enum class TableVerdict : std::uint8_t {
  kAccepted,
  kForeign,  // a table for another robot
  kNewer,    // a format that this firmware does not know yet
  kRefused,  // anything else: signature, limits, structure
};

class TableVerifier {
 public:
  virtual TableVerdict verify(std::span<const std::uint8_t> image) const = 0;

 protected:
  ~TableVerifier() = default;
};

enum class SlotState : std::uint8_t {
  kBlank,      // erased
  kTorn,       // an erase, upload or commit was interrupted, or the image does not match its CRC
  kForeign,    // not written by a slot store, or a table for another robot
  kNewer,      // layout or table format of a newer firmware
  kRefused,    // complete, but the table does not verify
  kPending,    // committed, waits for activation
  kTrial,      // active until the next start unless confirmed
  kConfirmed,  // active, or the fallback of a newer one
  kRejected,   // reverted, or a trial that a restart ended
};

enum class StoreResult : std::uint8_t {
  kDone,
  kTableRefused,       // the verifier does not accept the image
  kTooLarge,           // the image does not fit in a slot, or a stored one not in the buffer
  kTrialRunning,       // confirm or revert first: a restart returns to the other slot
  kNothingPending,     // no committed table waits for activation
  kNoTrial,            // nothing to confirm, nothing to revert
  kEraseFailed,        // the memory did not erase
  kProgramFailed,      // a word does not read back as programmed
  kImageChanged,       // the slot's image does not match its CRC
  kSequenceExhausted,  // 2^32 - 1 commits
};

struct SlotStatus {
  SlotState state = SlotState::kBlank;
  std::uint32_t sequence = 0;  // 0 where the slot has no valid header
  std::uint32_t length = 0;    // bytes of the image, likewise
};

struct StoreStatus {
  std::array<SlotStatus, kSlots> slot;
  std::optional<std::size_t> active;  // none: pass-through
};

class SlotStore {
 public:
  // Neither is owned; both must outlive the store.
  SlotStore(Flash& flash, const TableVerifier& verifier) : flash_(flash), verifier_(verifier) {}

  // Reads both slots, ends an unconfirmed trial, and copies the active image into `buffer`. Returns
  // that image, empty where there is none (pass-through). Call once, before anything else. `buffer`
  // is used for both slots in turn; an image that does not fit counts as torn.
  std::span<const std::uint8_t> start(std::span<std::uint8_t> buffer);

  // Verifies `image` and writes it into the spare slot; it then waits for `activate`. May block for
  // seconds.
  StoreResult commit(std::span<const std::uint8_t> image);

  // Copies the pending image into `buffer`, verifies it again, and sets `image` to it. On any other
  // result than kDone `image` is untouched.
  StoreResult load_pending(std::span<std::uint8_t> buffer, std::span<const std::uint8_t>& image);

  // Marks the trial of the image that load_pending() returned last. On any other result than kDone
  // the active table is as before.
  StoreResult begin_trial();

  // Both: load_pending(), then begin_trial().
  StoreResult activate(std::span<std::uint8_t> buffer, std::span<const std::uint8_t>& image);

  // Makes the table on trial the table of every later start.
  StoreResult confirm();

  // Ends the trial, or drops the pending image. After a trial the caller loads the previous table
  // by `load_active`.
  StoreResult revert();

  // Copies the active image into `buffer`; empty where there is none or it does not verify any
  // more.
  std::span<const std::uint8_t> load_active(std::span<std::uint8_t> buffer);

  // Bytes of the largest image that a slot takes.
  std::size_t capacity() const { return flash_.slot_size() - kHeaderBytes; }

  const StoreStatus& status() const { return status_; }

  // True if the image that was stored last was complete and is now damaged, so that the active
  // table is older or none. An interrupted upload or erase does not count.
  bool has_lost_newest() const;

 private:
  HeaderWords read_header(std::size_t slot) const;
  bool is_blank(std::size_t slot, std::size_t from_byte) const;
  bool program(std::size_t slot, std::size_t word_index, std::uint32_t word);
  bool append(std::size_t slot, Mark mark);
  bool erase(std::size_t slot);
  bool make_erased(std::size_t slot);
  bool program_image(std::size_t slot, std::span<const std::uint8_t> image);
  bool program_header(std::size_t slot, std::span<const std::uint8_t> image,
                      std::uint32_t sequence);
  std::span<const std::uint8_t> load(std::size_t slot, std::span<std::uint8_t> buffer) const;
  SlotStatus classify(std::size_t slot, std::span<std::uint8_t> buffer);
  SlotState classify_unsealed(std::size_t slot, const HeaderWords& words) const;
  SlotState settle(std::size_t slot, const JournalReading& journal);
  std::optional<std::size_t> slot_in(SlotState state) const;
  std::optional<std::size_t> newest_confirmed() const;
  std::size_t spare() const;

  Flash& flash_;
  const TableVerifier& verifier_;
  StoreStatus status_;
  std::array<std::uint32_t, kSlots> image_crc_ = {};
};

}  // namespace armtrue::storage

#endif  // ARMTRUE_FIRMWARE_STORAGE_SLOT_STORE_H_
