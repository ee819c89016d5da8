// Transfer of a table to the device: DOMAIN 0x2010 into RAM, verified, committed to flash, on
// trial, confirmed or reverted; commands in 0x2012, state in 0x2013.
//
//   empty -> receiving -> received -> verified -> (committed to spare slot) -> trial -> confirmed
//                                  -> refused (0x2013 sub 2: why, sub 15: at which byte)
//
// Everything that writes flash or takes long (one signature check: tens of milliseconds) is refused
// with "device state" while joint commands arrive; so is the beginning of a download.
#ifndef ARMTRUE_FIRMWARE_CANOPEN_TABLE_TABLE_TRANSFER_H_
#define ARMTRUE_FIRMWARE_CANOPEN_TABLE_TABLE_TRANSFER_H_

#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/canopen/protocol/dictionary_access.h"
#include "firmware/canopen/protocol/emcy.h"
#include "firmware/canopen/protocol/object_dictionary.h"
#include "firmware/canopen/table/table_buffers.h"
#include "firmware/core/compensator.h"
#include "firmware/core/table/table.h"
#include "firmware/storage/slot_store.h"

namespace armtrue::canopen {

inline constexpr std::uint16_t kStagingObject = 0x2010;
inline constexpr std::uint16_t kActiveObject = 0x2011;

// 0x2013 sub 1.
enum class StagingState : std::uint8_t {
  kEmpty = 0,
  kReceiving = 1,
  kReceived = 2,
  kVerified = 3,
  kRefused = 4,
  kCommitted = 5,
};

// 0x2012: four ASCII letters each, as 0x1010's "save", so that a stray write is no command.
enum class TableCommand : std::uint32_t {
  kVerify = 0x79667276,    // "vrfy"
  kCommit = 0x74696D63,    // "cmit"
  kActivate = 0x76746361,  // "actv"
  kConfirm = 0x6D726663,   // "cfrm"
  kRevert = 0x74727672,    // "rvrt"
  kDiscard = 0x64637364,   // "dscd": empties the staging buffer
};

// Gives the slot store the table reader's verdict on an image.
class IdentityVerifier final : public storage::TableVerifier {
 public:
  explicit IdentityVerifier(const DeviceIdentity& device) : device_(device) {}
  storage::TableVerdict verify(std::span<const std::uint8_t> image) const override;

 private:
  const DeviceIdentity& device_;
};

// What the drives permit. `passive`: bit k, axis k has no drive according to the table in question;
// such an axis need not report its state.
class DriveGuard {
 public:
  // Whether the core may stall while flash is erased.
  virtual bool may_erase(std::uint8_t passive) const = 0;
  // Whether a table may come into force that has other passive joints than the one before. Other
  // targets then form a set, and those that are mapped may pass uncorrected from now on.
  virtual bool may_change_axes(std::uint8_t passive) const = 0;

 protected:
  ~DriveGuard() = default;
};

class TableTransfer final : public DomainHandler {
 public:
  TableTransfer(ObjectDictionary& dictionary, Compensator& compensator, storage::SlotStore& store,
                Emcy& emcy, const DeviceIdentity& device, const TableMemory& memory,
                const DriveGuard& drives);

  // Reads the slots and puts their table in force. Call once at power-on and at NMT reset node, not
  // while joint commands arrive.
  void start();

  // Carries out a command. `quiet`: no joint commands have arrived for the quiet time.
  Abort command(std::uint32_t word, bool quiet);

  // Whether a download may begin now; asked by begin_download().
  void set_quiet(bool quiet) { quiet_ = quiet; }

  // Enables (only while quiet: the table is checked again) or disables (at any time) the
  // correction, 0x2000 sub 2. Blended by the compensator.
  void set_enabled(bool enabled);
  // Whether set_enabled(true) may be called.
  Abort check_enable();

  // Brings 0x2013 up to date. Cheap: it is read while joints move.
  void refresh_status();

  // Whether the image in force still validates; true where there is none. Takes long.
  bool active_is_sound() const {
    return buffers_.active().empty() || validate(buffers_.active(), device_).accepted();
  }

  std::uint32_t refused() const { return refused_; }
  bool on_trial() const { return trial_; }

  Abort begin_download(std::uint16_t index, std::uint32_t size) override;
  Abort append(std::span<const std::uint8_t> piece) override;
  Abort finish_download() override;
  void cancel_download() override;
  Abort begin_upload(std::uint16_t index, std::span<const std::uint8_t>& content) override;

 private:
  Abort verify();
  Abort commit();
  Abort activate();
  Abort confirm();
  Abort revert();
  Abort discard();
  Abort result(storage::StoreResult result);
  Abort refuse(std::uint16_t reason, std::uint32_t field);
  Abort refuse_now();
  Abort check_axes(std::uint8_t passive);
  void forget_other_axes();
  void use(std::span<const std::uint8_t> image);
  Validation check_resolution(std::span<const std::uint8_t> image) const;
  Validation check(std::span<const std::uint8_t> image) const;
  void put_in_force();
  // Where 0x608F is 0, sets it to the scale of the table in force, which later tables must have.
  // Not for a table on trial: a restart ends the trial, and saved parameters would keep the scale.
  void agree_on_resolution();
  std::size_t capacity() const;

  ObjectDictionary& dictionary_;
  Compensator& compensator_;
  storage::SlotStore& store_;
  Emcy& emcy_;
  const DeviceIdentity& device_;
  const DriveGuard& drives_;
  TableBuffers buffers_;
  bool quiet_ = true;
  bool enabled_ = true;
  bool trial_ = false;
  StagingState state_ = StagingState::kEmpty;
  std::uint32_t staged_ = 0;  // bytes
  // 0x2013 sub 4 (sub 13: active_checksum_), updated as the bytes arrive. It covers all but the
  // last four bytes, the image's own CRC: over data and its CRC, a CRC is the same for every image.
  std::uint32_t staged_checksum_ = 0;
  std::uint8_t passive_before_trial_ = 0;  // passive joints of the table that revert() returns to
  std::uint32_t active_checksum_ = 0;
  std::uint16_t refusal_reason_ = 0;  // 0x2013 sub 2
  std::uint32_t refusal_field_ = 0;   // 0x2013 sub 15
  storage::StoreResult last_result_ = storage::StoreResult::kDone;
  std::uint32_t refused_ = 0;
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_TABLE_TABLE_TRANSFER_H_
