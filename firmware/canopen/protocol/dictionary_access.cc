#include "firmware/canopen/protocol/dictionary_access.h"

#include <algorithm>
#include <cstring>

#include "firmware/core/fixed/counter.h"

namespace armtrue::canopen {
namespace {

bool has(const od::Entry& entry, od::EntryFlags flag) { return (entry.flags & flag) != 0; }

bool is_variable(const od::Entry& entry) {
  return entry.type == od::Type::kDomain || entry.type == od::Type::kVisibleString;
}

}  // namespace

Abort DictionaryAccess::locate(std::uint16_t index, std::uint8_t sub) {
  cancel();
  entry_ = dictionary_.find(index, sub);
  if (entry_) return Abort::kNone;
  return dictionary_.has_index(index) ? Abort::kNoSubIndex : Abort::kNoObject;
}

Abort DictionaryAccess::begin_write(std::uint16_t index, std::uint8_t sub, std::uint32_t size,
                                    std::uint32_t& expected) {
  if (const Abort abort = locate(index, sub); abort != Abort::kNone) return abort;
  if (!has(*entry_, od::kWritable)) {
    count(refused_writes_);
    return Abort::kReadOnly;
  }
  expected = is_variable(*entry_) ? 0 : entry_->size;
  announced_ = size;
  received_ = 0;
  if (entry_->type == od::Type::kDomain) {
    const Abort abort = domains_.begin_download(index, size);
    writing_domain_ = abort == Abort::kNone;
    return abort;
  }
  if (size != kUnknownSize && size > entry_->size) return Abort::kTooLong;
  if (size != kUnknownSize && size < expected) return Abort::kTooShort;
  return Abort::kNone;
}

Abort DictionaryAccess::append(std::span<const std::uint8_t> piece) {
  if (announced_ != kUnknownSize && piece.size() > announced_ - received_) return Abort::kTooLong;
  if (writing_domain_) {
    received_ += static_cast<std::uint32_t>(piece.size());
    return domains_.append(piece);
  }
  if (piece.size() > static_cast<std::size_t>(entry_->size) - received_) return Abort::kTooLong;
  std::copy(piece.begin(), piece.end(), buffer_.begin() + received_);
  received_ += static_cast<std::uint32_t>(piece.size());
  return Abort::kNone;
}

Abort DictionaryAccess::check_limits(std::span<const std::uint8_t> value) const {
  const od::Limit* limit = dictionary_.limit(*entry_);
  if (limit == nullptr) return Abort::kNone;
  const std::uint32_t number = load_le(value);
  if (number > limit->high) return Abort::kValueTooHigh;
  return number < limit->low ? Abort::kValueTooLow : Abort::kNone;
}

Abort DictionaryAccess::finish_write() {
  if (announced_ != kUnknownSize && received_ != announced_) return Abort::kLength;
  if (writing_domain_) {
    writing_domain_ = false;
    return domains_.finish_download();
  }
  if (!is_variable(*entry_) && received_ < entry_->size) return Abort::kTooShort;
  const std::span<const std::uint8_t> value(buffer_.data(), received_);
  if (const Abort abort = check_limits(value); abort != Abort::kNone) return abort;
  if (const Abort abort = hooks_.before_write(*entry_, value); abort != Abort::kNone) return abort;
  dictionary_.assign(*entry_, value);
  hooks_.after_write(*entry_);
  return Abort::kNone;
}

Abort DictionaryAccess::begin_read(std::uint16_t index, std::uint8_t sub, std::uint32_t& size) {
  if (const Abort abort = locate(index, sub); abort != Abort::kNone) return abort;
  if (!has(*entry_, od::kReadable)) return Abort::kWriteOnly;
  if (entry_->type == od::Type::kDomain) {
    const Abort abort = domains_.begin_upload(index, content_);
    if (abort != Abort::kNone) return abort;
  } else {
    if (const Abort abort = hooks_.before_read(index, sub); abort != Abort::kNone) return abort;
    // A copy: a value that changes during a segmented upload must not mix old and new bytes.
    const std::span<const std::uint8_t> value = dictionary_.bytes(*entry_);
    std::copy(value.begin(), value.end(), buffer_.begin());
    content_ = {buffer_.data(), value.size()};
  }
  size = static_cast<std::uint32_t>(content_.size());
  return Abort::kNone;
}

void DictionaryAccess::read(std::uint32_t offset, std::span<std::uint8_t> out) const {
  std::memcpy(out.data(), content_.data() + offset, out.size());
}

void DictionaryAccess::cancel() {
  if (writing_domain_) domains_.cancel_download();
  writing_domain_ = false;
  content_ = {};
}

}  // namespace armtrue::canopen
