// SDO access to the dictionary: access rights, sizes, limits, side effects, DOMAINs.
//
// A transfer is a stream: begin, any number of pieces, finish. Ordinary objects are collected in a
// small buffer and take effect at finish, all at once; a DOMAIN goes directly to its handler.
#ifndef ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_DICTIONARY_ACCESS_H_
#define ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_DICTIONARY_ACCESS_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/canopen/protocol/object_dictionary.h"
#include "firmware/canopen/protocol/sdo_abort.h"

namespace armtrue::canopen {

// The size of a transfer whose sender did not announce it.
inline constexpr std::uint32_t kUnknownSize = 0xFFFFFFFF;

// A DOMAIN object's content. One transfer at a time.
class DomainHandler {
 public:
  // `size` in bytes, or kUnknownSize.
  virtual Abort begin_download(std::uint16_t index, std::uint32_t size) = 0;
  virtual Abort append(std::span<const std::uint8_t> piece) = 0;
  virtual Abort finish_download() = 0;
  virtual void cancel_download() = 0;
  // The content to upload; it must stay unchanged until the transfer ends. On kNone `content` is
  // set.
  virtual Abort begin_upload(std::uint16_t index, std::span<const std::uint8_t>& content) = 0;

 protected:
  ~DomainHandler() = default;
};

// The node's own checks and actions when an object is written or read, beyond the EDS.
class ObjectHooks {
 public:
  // May refuse a value that passed rights, size and limits. `value` is what would be stored.
  virtual Abort before_write(const od::Entry& entry, std::span<const std::uint8_t> value) = 0;
  // The value is in place: apply it.
  virtual void after_write(const od::Entry& entry) = 0;
  // Bring the value up to date; may refuse the read.
  virtual Abort before_read(std::uint16_t index, std::uint8_t sub) = 0;

 protected:
  ~ObjectHooks() = default;
};

class DictionaryAccess {
 public:
  DictionaryAccess(ObjectDictionary& dictionary, ObjectHooks& hooks, DomainHandler& domains)
      : dictionary_(dictionary), hooks_(hooks), domains_(domains) {}

  // Begins a download of `size` bytes or kUnknownSize. `expected` becomes the object's size, 0
  // where it varies. Any earlier transfer is cancelled.
  Abort begin_write(std::uint16_t index, std::uint8_t sub, std::uint32_t size,
                    std::uint32_t& expected);
  Abort append(std::span<const std::uint8_t> piece);
  Abort finish_write();

  // Begins an upload; `size` becomes its length in bytes.
  Abort begin_read(std::uint16_t index, std::uint8_t sub, std::uint32_t& size);
  // Copies bytes from `offset` on. Precondition: within the size of the upload.
  void read(std::uint32_t offset, std::span<std::uint8_t> out) const;

  void cancel();

  // Number of refused writes to objects that are not writable; saturates.
  std::uint32_t refused_writes() const { return refused_writes_; }

 private:
  // Cancels any transfer and looks up an entry; the abort code if it does not exist.
  Abort locate(std::uint16_t index, std::uint8_t sub);
  Abort check_limits(std::span<const std::uint8_t> value) const;

  ObjectDictionary& dictionary_;
  ObjectHooks& hooks_;
  DomainHandler& domains_;
  std::optional<od::Entry> entry_;
  std::uint32_t announced_ = kUnknownSize;
  std::uint32_t received_ = 0;
  std::uint32_t refused_writes_ = 0;
  bool writing_domain_ = false;
  std::span<const std::uint8_t> content_;  // of an upload
  std::array<std::uint8_t, 64> buffer_ = {};
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_DICTIONARY_ACCESS_H_
