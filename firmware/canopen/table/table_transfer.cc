#include "firmware/canopen/table/table_transfer.h"

#include <algorithm>

#include "firmware/core/crypto/crc32.h"
#include "firmware/core/fixed/bytes.h"
#include "firmware/core/fixed/counter.h"
#include "firmware/core/fixed/ratio.h"
#include "firmware/core/table/format.h"
#include "firmware/core/table/limits.h"
#include "firmware/core/table/table_view.h"

namespace armtrue::canopen {
namespace {

// Values of 0x2013 sub 2 in addition to the table reader's reasons (core/table/table.h).
enum UploadRefusal : std::uint16_t {
  kFits = 0,
  kOlderThanActive = 0x100,  // replay: an earlier export than the table in force
  kLimitsTooWide = 0x101,    // asks for larger corrections than this firmware ever makes
  kOtherAxes = 0x102,        // other passive joints than the table before; not now
};
constexpr std::uint8_t kNoSlot = 0xFF;

// How many bytes of an image of `length` its checksum covers: all but those that hold it.
std::uint32_t checked(std::uint32_t length) {
  constexpr std::uint32_t kOwn = format::kChecksumLength;
  return std::max(length, kOwn) - kOwn;
}

// Whether the table's limits exceed those of the firmware. The compensator would cap them, but the
// table's author expects larger corrections.
bool limits_are_too_wide(std::span<const std::uint8_t> image) {
  const TableView table(image);
  for (std::size_t k = 0; k < table.joint_count(); ++k) {
    const std::uint8_t* joint = table.joint(k);
    const bool prismatic = table.is_prismatic(k);
    if (load_i32(joint + format::joint::kMagnitudeAt) >
            (prismatic ? kMaxDeltaPrismatic : kMaxDeltaRevolute) ||
        load_i32(joint + format::joint::kRateAt) >
            (prismatic ? kMaxRatePrismatic : kMaxRateRevolute)) {
      return true;
    }
  }
  return false;
}

// Not inlined: a TableView would stay on the stack during the signature check.
[[gnu::noinline]] std::uint8_t passive_in(std::span<const std::uint8_t> image) {
  return TableView(image).passive();
}

// Mantissa of the increments per unit, without sign and power of two.
std::uint64_t mantissa_of(const std::uint8_t* joint) {
  return magnitude(load_i32(joint + format::joint::kIncrementPerUnitAt));
}

// 0x608F: increments of a drive for `units` turns (revolute) or metres (prismatic) of its joint.
struct Resolution {
  std::uint32_t increments;
  std::uint32_t units;
};

// The resolution in a table, in whole numbers as exact as 32 bits allow.
Resolution resolution_of(const TableView& table, std::size_t k) {
  const std::uint8_t* joint = table.joint(k);
  const std::uint64_t mantissa = mantissa_of(joint);
  const int down = joint[format::joint::kIncrementShiftAt] - 32;  // a turn or a metre: 2^32 units
  const auto increments = [mantissa, down](std::uint64_t units) {
    const std::uint64_t product = mantissa * units;
    if (down <= 0) return product << -down;
    return (product + (std::uint64_t{1} << (down - 1))) >> down;
  };
  std::uint32_t units = 1;
  const bool is_whole = down <= 0 || (mantissa & ((std::uint64_t{1} << down) - 1U)) == 0;
  while (!is_whole && units < 100'000'000 && increments(units * 10ULL) <= UINT32_MAX) units *= 10;
  return {static_cast<std::uint32_t>(std::min<std::uint64_t>(increments(units), UINT32_MAX)),
          units};
}

// Whether `image` is an older export than `active`, or another table with its export number.
bool is_replay(std::span<const std::uint8_t> image, std::span<const std::uint8_t> active) {
  if (active.empty()) return false;
  const TableInfo staged = describe(image);
  const TableInfo present = describe(active);
  const bool same = staged.sequence == present.sequence && staged.checksum == present.checksum;
  return staged.sequence <= present.sequence && !same;
}

}  // namespace

storage::TableVerdict IdentityVerifier::verify(std::span<const std::uint8_t> image) const {
  const Validation validation = validate(image, device_);
  switch (validation.refusal) {
    case Refusal::kNone:
      return storage::TableVerdict::kAccepted;
    case Refusal::kRobotSerial:
    case Refusal::kJointCount:
      return storage::TableVerdict::kForeign;
    case Refusal::kNewerFormat:
      return storage::TableVerdict::kNewer;
    default:
      return storage::TableVerdict::kRefused;
  }
}

TableTransfer::TableTransfer(ObjectDictionary& dictionary, Compensator& compensator,
                             storage::SlotStore& store, Emcy& emcy, const DeviceIdentity& device,
                             const TableMemory& memory, const DriveGuard& drives)
    : dictionary_(dictionary),
      compensator_(compensator),
      store_(store),
      emcy_(emcy),
      device_(device),
      drives_(drives),
      buffers_(memory, compensator) {}

std::size_t TableTransfer::capacity() const {
  return std::min(buffers_.capacity(), store_.capacity());
}

void TableTransfer::start() {
  const std::span<const std::uint8_t> image = store_.start(buffers_.writable());
  if (!image.empty()) use(image);
  // The table that was stored last is damaged: an older one, or none, is in force.
  if (store_.has_lost_newest()) {
    emcy_.raise(Condition::kStorage,
                static_cast<std::uint32_t>(storage::StoreResult::kImageChanged));
  }
}

// Compares a table's scales with 0x608F, without sign: the object has none, and the table alone
// gives the direction in which a drive counts. Precondition: the image validates.
Validation TableTransfer::check_resolution(std::span<const std::uint8_t> image) const {
  const TableView table(image);
  for (std::size_t k = 0; k < table.joint_count(); ++k) {
    const std::uint8_t* joint = table.joint(k);
    const std::uint32_t increments = dictionary_.get(od::axis::kEncoderIncrements[k]);
    if (increments == 0) continue;
    const Scaled asked = {mantissa_of(joint) * dictionary_.get(od::axis::kMotorRevolutions[k]),
                          32 - joint[format::joint::kIncrementShiftAt]};
    if (!nearly_equal(asked, {increments, 0})) {
      const auto at = static_cast<std::uint32_t>(joint - image.data());
      return {Refusal::kResolution, at + std::uint32_t{format::joint::kIncrementPerUnitAt}};
    }
  }
  return {};
}

Validation TableTransfer::check(std::span<const std::uint8_t> image) const {
  const Validation validation = validate(image, device_);
  return validation.accepted() ? check_resolution(image) : validation;
}

void TableTransfer::put_in_force() {
  const std::span<const std::uint8_t> image = buffers_.active();
  if (image.empty() || !enabled_) return compensator_.disable();
  Validation validation = compensator_.load(image, device_);
  if (validation.accepted()) validation = check_resolution(image);
  if (validation.accepted()) {
    compensator_.activate();
    if (!trial_) agree_on_resolution();
    return;
  }
  compensator_.disable();
  refuse(static_cast<std::uint16_t>(validation.refusal), validation.field);
}

void TableTransfer::agree_on_resolution() {
  const TableView table(buffers_.active());
  for (std::size_t k = 0; k < table.joint_count(); ++k) {
    if (dictionary_.get(od::axis::kEncoderIncrements[k]) != 0) continue;
    const Resolution own = resolution_of(table, k);
    dictionary_.set(od::axis::kEncoderIncrements[k], own.increments);
    dictionary_.set(od::axis::kMotorRevolutions[k], own.units);
  }
}

void TableTransfer::use(std::span<const std::uint8_t> image) {
  buffers_.put_in_force(image);
  active_checksum_ = 0;
  if (!image.empty()) {
    active_checksum_ = crc32(image.first(checked(static_cast<std::uint32_t>(image.size()))));
    discard();
  }
  put_in_force();
}

void TableTransfer::set_enabled(bool enabled) {
  if (enabled == enabled_) return;
  enabled_ = enabled;
  put_in_force();
}

Abort TableTransfer::check_enable() {
  forget_other_axes();
  const bool changes = !enabled_ && !buffers_.active().empty();
  return changes ? check_axes(passive_in(buffers_.active())) : Abort::kNone;
}

Abort TableTransfer::command(std::uint32_t word, bool quiet) {
  const auto command = static_cast<TableCommand>(word);
  if (command == TableCommand::kDiscard) return discard();
  const bool known = command == TableCommand::kVerify || command == TableCommand::kCommit ||
                     command == TableCommand::kActivate || command == TableCommand::kConfirm ||
                     command == TableCommand::kRevert;
  if (!known) return Abort::kValueRange;
  if (!quiet) return refuse_now();
  forget_other_axes();
  switch (command) {
    case TableCommand::kVerify:
      return verify();
    case TableCommand::kCommit:
      return commit();
    case TableCommand::kActivate:
      return activate();
    case TableCommand::kConfirm:
      return confirm();
    default:
      return revert();
  }
}

Abort TableTransfer::refuse(std::uint16_t reason, std::uint32_t field) {
  state_ = StagingState::kRefused;
  refusal_reason_ = reason;
  refusal_field_ = field;
  count(refused_);
  // Each refused image is reported.
  emcy_.clear(Condition::kTableRefused);
  emcy_.raise(Condition::kTableRefused, reason);
  return Abort::kIncompatibleParameter;
}

// The state of the arm forbids a request; the staged table stays as it is.
Abort TableTransfer::refuse_now() {
  count(refused_);
  return Abort::kDeviceState;
}

// This reason depends on the drives, so that it tells about the last request only.
void TableTransfer::forget_other_axes() {
  if (refusal_reason_ == kOtherAxes) refusal_reason_ = kFits;
}

// Before the first table nothing is corrected, and no drive holds a correction of this node.
Abort TableTransfer::check_axes(std::uint8_t passive) {
  if (!compensator_.has_had_table() || passive == compensator_.passive() ||
      drives_.may_change_axes(passive)) {
    return Abort::kNone;
  }
  refusal_reason_ = kOtherAxes;
  refusal_field_ = 0;
  return refuse_now();
}

Abort TableTransfer::verify() {
  if (state_ == StagingState::kVerified || state_ == StagingState::kCommitted) return Abort::kNone;
  if (state_ != StagingState::kReceived) return Abort::kDeviceState;
  const std::span<const std::uint8_t> image = buffers_.staged(staged_);
  const Validation validation = check(image);
  if (!validation.accepted()) {
    return refuse(static_cast<std::uint16_t>(validation.refusal), validation.field);
  }
  if (limits_are_too_wide(image)) return refuse(kLimitsTooWide, 0);
  if (is_replay(image, buffers_.active()))
    return refuse(kOlderThanActive, format::header::kSequenceAt);
  state_ = StagingState::kVerified;
  emcy_.clear(Condition::kTableRefused);
  return Abort::kNone;
}

Abort TableTransfer::result(storage::StoreResult result) {
  last_result_ = result;
  switch (result) {
    case storage::StoreResult::kDone:
      emcy_.clear(Condition::kStorage);
      return Abort::kNone;
    case storage::StoreResult::kEraseFailed:
    case storage::StoreResult::kProgramFailed:
    case storage::StoreResult::kImageChanged:
      emcy_.raise(Condition::kStorage, static_cast<std::uint32_t>(result));
      return Abort::kHardware;
    case storage::StoreResult::kTooLarge:
      return Abort::kOutOfMemory;
    default:
      count(refused_);
      return Abort::kDeviceState;
  }
}

Abort TableTransfer::commit() {
  if (state_ == StagingState::kCommitted) return Abort::kNone;
  if (state_ != StagingState::kVerified) return Abort::kDeviceState;
  const std::span<const std::uint8_t> image = buffers_.staged(staged_);
  // When the first table of a device is committed, only this table tells which axes have drives.
  if (!drives_.may_erase(passive_in(image))) return refuse_now();
  const Abort abort = result(store_.commit(image));
  if (abort == Abort::kNone) state_ = StagingState::kCommitted;
  return abort;
}

Abort TableTransfer::activate() {
  const std::span<std::uint8_t> buffer = buffers_.writable();
  if (buffer.empty()) return Abort::kDeviceState;
  std::span<const std::uint8_t> image;
  storage::StoreResult loaded = store_.load_pending(buffer, image);
  if (loaded == storage::StoreResult::kDone) {
    const Abort refusal = enabled_ ? check_axes(passive_in(image)) : Abort::kNone;
    if (refusal != Abort::kNone) {
      // The image of the slot has replaced the staged one.
      discard();
      refusal_reason_ = kOtherAxes;
      return refusal;
    }
    loaded = store_.begin_trial();
  }
  const Abort abort = result(loaded);
  if (abort == Abort::kNone) {
    const std::span<const std::uint8_t> before = buffers_.active();
    passive_before_trial_ = before.empty() ? passive_in(image) : passive_in(before);
    trial_ = true;
    use(image);
  } else if (last_result_ != storage::StoreResult::kNothingPending) {
    // The store may have read the slot's image into the staging buffer: the image staged there is
    // lost and must not count as verified. With nothing pending the store has not touched it.
    discard();
  }
  return abort;
}

Abort TableTransfer::confirm() {
  const Abort abort = result(store_.confirm());
  if (abort == Abort::kNone) {
    trial_ = false;
    // Also of a table that is disabled: the next one is compared with it.
    const std::span<const std::uint8_t> image = buffers_.active();
    if (!image.empty() && check_resolution(image).accepted()) agree_on_resolution();
  }
  return abort;
}

Abort TableTransfer::revert() {
  const bool was_trial = trial_;
  if (was_trial && buffers_.writable().empty()) return Abort::kDeviceState;
  if (was_trial && enabled_) {
    if (const Abort abort = check_axes(passive_before_trial_); abort != Abort::kNone) return abort;
  }
  const Abort abort = result(store_.revert());
  // A trial is over even if its mark could not be written: the next start rejects it in any case.
  if (abort != Abort::kNone && abort != Abort::kHardware) return abort;
  if (was_trial) {
    trial_ = false;
    use(store_.load_active(buffers_.writable()));
  } else if (state_ == StagingState::kCommitted) {
    state_ = StagingState::kVerified;  // the image is still staged, but in no slot any more
  }
  return abort;
}

Abort TableTransfer::discard() {
  staged_ = 0;
  staged_checksum_ = 0;
  state_ = StagingState::kEmpty;
  refusal_reason_ = kFits;
  refusal_field_ = 0;
  return Abort::kNone;
}

Abort TableTransfer::begin_download(std::uint16_t index, std::uint32_t size) {
  if (index != kStagingObject) return Abort::kUnsupportedAccess;
  if (!quiet_) {
    count(refused_);
    return Abort::kDeviceState;
  }
  if (buffers_.writable().empty()) return Abort::kDeviceState;
  if (size != kUnknownSize && size > capacity()) return Abort::kOutOfMemory;
  discard();
  state_ = StagingState::kReceiving;
  return Abort::kNone;
}

Abort TableTransfer::append(std::span<const std::uint8_t> piece) {
  const std::span<std::uint8_t> buffer = buffers_.writable();
  if (buffer.empty()) return Abort::kDeviceState;
  if (piece.size() > capacity() - staged_) return Abort::kOutOfMemory;
  std::copy(piece.begin(), piece.end(), buffer.begin() + staged_);
  // Updated with every piece: at the end it would take milliseconds, while joints may move again.
  const std::uint32_t before = checked(staged_);
  staged_ += static_cast<std::uint32_t>(piece.size());
  staged_checksum_ = crc32(buffer.subspan(before, checked(staged_) - before), staged_checksum_);
  return Abort::kNone;
}

Abort TableTransfer::finish_download() {
  state_ = StagingState::kReceived;
  return Abort::kNone;
}

void TableTransfer::cancel_download() { discard(); }

Abort TableTransfer::begin_upload(std::uint16_t index, std::span<const std::uint8_t>& content) {
  const bool received = state_ != StagingState::kEmpty && state_ != StagingState::kReceiving;
  if (index == kActiveObject) {
    content = buffers_.active();
  } else {
    content = received ? buffers_.staged(staged_) : std::span<const std::uint8_t>();
  }
  return content.empty() ? Abort::kNoData : Abort::kNone;
}

void TableTransfer::refresh_status() {
  namespace status = od::table_status;
  const storage::StoreStatus& store = store_.status();
  dictionary_.set(status::kStagingState, static_cast<std::uint8_t>(state_));
  dictionary_.set(status::kRefusalReason, refusal_reason_);
  dictionary_.set(status::kRefusalByteOffset, refusal_field_);
  dictionary_.set(status::kBytesStaged, staged_);
  dictionary_.set(status::kChecksumOfStagedImage, staged_checksum_);
  dictionary_.set(status::kCapacity, static_cast<std::uint32_t>(capacity()));
  dictionary_.set(status::kFormatVersionRead, format::kVersion);
  dictionary_.set(status::kSignatureRequired, static_cast<std::uint8_t>(device_.has_key));
  dictionary_.set(status::kSlotAState, static_cast<std::uint8_t>(store.slot[0].state));
  dictionary_.set(status::kSlotASequenceNumber, store.slot[0].sequence);
  dictionary_.set(status::kSlotBState, static_cast<std::uint8_t>(store.slot[1].state));
  dictionary_.set(status::kSlotBSequenceNumber, store.slot[1].sequence);
  dictionary_.set(status::kActiveSlot,
                  store.active ? static_cast<std::uint8_t>(*store.active) : kNoSlot);
  dictionary_.set(status::kChecksumOfActiveImage, active_checksum_);
  dictionary_.set(status::kActiveTableSequence,
                  buffers_.active().empty() ? 0U : describe(buffers_.active()).sequence);
  dictionary_.set(status::kTrial, static_cast<std::uint8_t>(trial_));
  dictionary_.set(status::kStoreResult, static_cast<std::uint8_t>(last_result_));
}

}  // namespace armtrue::canopen
