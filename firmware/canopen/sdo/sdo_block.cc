// Block transfer of the SDO server (CiA 301, 7.2.4.3.9 to 7.2.4.3.16).
#include <algorithm>
#include <span>

#include "firmware/canopen/protocol/crc16.h"
#include "firmware/canopen/protocol/little_endian.h"
#include "firmware/canopen/sdo/sdo_server.h"

namespace armtrue::canopen {
namespace {

constexpr std::uint8_t kMaxBlockSize = 127;
constexpr std::uint8_t kClientCrc = 0x04;
constexpr std::uint8_t kSizeIndicated = 0x02;
constexpr std::uint8_t kLastSegment = 0x80;

// Sub-commands, the low bits of the first byte.
constexpr std::uint8_t kInitiate = 0;
constexpr std::uint8_t kEnd = 1;
constexpr std::uint8_t kAcknowledge = 2;
constexpr std::uint8_t kStart = 3;

}  // namespace

void SdoServer::handle_block_download(const std::uint8_t* request) {
  if ((request[0] & 1U) == kInitiate) return initiate_block_download(request);
  if (state_ != State::kBlockDownloadEnd) return abort(Abort::kCommandSpecifier);
  end_block_download(request);
}

void SdoServer::initiate_block_download(const std::uint8_t* request) {
  finish();
  take_multiplexer(request);
  const bool sized = (request[0] & kSizeIndicated) != 0;
  const std::uint32_t size = sized ? announced_size(request) : kUnknownSize;
  std::uint32_t expected = 0;
  if (const Abort code = access_.begin_write(index_, sub_, size, expected); code != Abort::kNone) {
    return abort(code);
  }
  with_crc_ = (request[0] & kClientCrc) != 0;
  crc_ = 0;
  sequence_ = 0;
  block_size_ = port_.longest_burst();
  last_segment_seen_ = false;
  has_held_ = false;
  state_ = State::kBlockDownload;
  Payload answer = response(0xA4);
  answer[4] = block_size_;
  respond(answer);
}

void SdoServer::block_download_segment(const std::uint8_t* segment) {
  const std::uint8_t number = segment[0] & 0x7FU;
  const bool last = (segment[0] & kLastSegment) != 0;
  if (number == 0 || number > block_size_) return abort(Abort::kSequenceNumber);
  if (number == sequence_ + 1) {
    if (has_held_) {
      crc_ = crc16(held_, crc_);
      if (const Abort code = access_.append(held_); code != Abort::kNone) return abort(code);
    }
    std::copy_n(segment + 1, kSegmentBytes, held_.begin());
    has_held_ = true;
    sequence_ = number;
    last_segment_seen_ = last;
  }
  // A segment out of sequence is not taken; the acknowledgement of the sub-block tells the client
  // from where to repeat.
  if (last || number == block_size_) acknowledge_sub_block();
}

// Whether a request is the last segment once more: its first byte would be read as a command, in
// short blocks as an abort.
bool SdoServer::is_last_segment_again(const std::uint8_t* request) const {
  return state_ == State::kBlockDownloadEnd && request[0] == (kLastSegment | sequence_) &&
         std::equal(held_.begin(), held_.end(), request + 1);
}

void SdoServer::acknowledge_sub_block() {
  Payload answer = {};
  answer[0] = 0xA2;
  answer[1] = sequence_;
  answer[2] = block_size_;
  if (last_segment_seen_) {
    state_ = State::kBlockDownloadEnd;
  } else {
    sequence_ = 0;
  }
  respond(answer);
}

void SdoServer::end_block_download(const std::uint8_t* request) {
  const std::size_t length = kSegmentBytes - ((request[0] >> 2) & 7U);
  const std::span<const std::uint8_t> rest = std::span(held_).first(length);
  crc_ = crc16(rest, crc_);
  if (const Abort code = access_.append(rest); code != Abort::kNone) return abort(code);
  if (with_crc_ && load_le<std::uint16_t>(request + 1) != crc_) return abort(Abort::kCrc);
  if (const Abort code = access_.finish_write(); code != Abort::kNone) return abort(code);
  finish();
  Payload answer = {};
  answer[0] = 0xA1;
  respond(answer);
}

void SdoServer::handle_block_upload(const std::uint8_t* request) {
  switch (request[0] & 3U) {
    case kInitiate:
      return initiate_block_upload(request);
    case kStart:
      if (state_ != State::kBlockUploadStart) return abort(Abort::kCommandSpecifier);
      state_ = State::kBlockUploadSegments;
      return;
    case kAcknowledge:
      return block_upload_acknowledged(request);
    case kEnd:
    default:
      if (state_ != State::kBlockUploadEnd) return abort(Abort::kCommandSpecifier);
      return finish();
  }
}

void SdoServer::initiate_block_upload(const std::uint8_t* request) {
  finish();
  take_multiplexer(request);
  const std::uint8_t wanted = request[4];
  if (wanted == 0 || wanted > kMaxBlockSize) return abort(Abort::kBlockSize);
  if (const Abort code = access_.begin_read(index_, sub_, size_); code != Abort::kNone) {
    return abort(code);
  }
  // Objects up to the client's protocol switch threshold are sent by normal upload; a threshold of
  // 0 does not permit this (CiA 301, 7.2.4.3.13).
  if (request[5] != 0 && size_ <= request[5]) return respond_upload_initiated();
  with_crc_ = (request[0] & kClientCrc) != 0;
  crc_ = 0;
  crc_end_ = 0;
  offset_ = 0;
  sequence_ = 0;
  block_size_ = wanted;
  state_ = State::kBlockUploadStart;
  Payload answer = response(0xC6);
  store_le(&answer[4], size_);
  respond(answer);
}

bool SdoServer::send_block_segment() {
  if (state_ != State::kBlockUploadSegments || has_unsent_ || port_.has_backlog()) return false;
  const std::uint32_t at = offset_ + sequence_ * static_cast<std::uint32_t>(kSegmentBytes);
  const std::size_t length = std::min<std::size_t>(kSegmentBytes, size_ - at);
  const bool last = at + length == size_;
  Payload segment = {};
  segment[0] = static_cast<std::uint8_t>((sequence_ + 1U) | (last ? kLastSegment : 0U));
  const std::span<std::uint8_t> content = std::span(segment).subspan(1, length);
  access_.read(at, content);
  if (!transmit(segment)) return false;
  last_activity_us_ = now_us_;
  // The CRC is updated with each segment, so that no turn computes that of a whole block. Segments
  // sent again are already included.
  if (at == crc_end_) {
    crc_ = crc16(content, crc_);
    crc_end_ += static_cast<std::uint32_t>(length);
  }
  ++sequence_;
  if (last || sequence_ == block_size_) state_ = State::kBlockUploadAck;
  return true;
}

void SdoServer::block_upload_acknowledged(const std::uint8_t* request) {
  if (state_ != State::kBlockUploadAck) return abort(Abort::kCommandSpecifier);
  const std::uint8_t acknowledged = request[1];
  const std::uint8_t wanted = request[2];
  if (acknowledged > sequence_) return abort(Abort::kSequenceNumber);
  if (wanted == 0 || wanted > kMaxBlockSize) return abort(Abort::kBlockSize);
  offset_ += acknowledged * static_cast<std::uint32_t>(kSegmentBytes);
  block_size_ = wanted;
  sequence_ = 0;
  if (acknowledged == 0 || offset_ < size_) {
    state_ = State::kBlockUploadSegments;
    return;
  }
  state_ = State::kBlockUploadEnd;
  Payload end = {};
  // Bits 4..2: bytes of the last segment that hold no data.
  end[0] = static_cast<std::uint8_t>(0xC1U | (offset_ - size_) << 2);
  store_le(&end[1], with_crc_ ? crc_ : std::uint16_t{0});
  respond(end);
}

}  // namespace armtrue::canopen
