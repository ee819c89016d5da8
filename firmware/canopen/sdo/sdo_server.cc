#include "firmware/canopen/sdo/sdo_server.h"

#include <algorithm>
#include <cstring>
#include <span>

#include "firmware/canopen/protocol/little_endian.h"

namespace armtrue::canopen {
namespace {

// Client command specifiers, bits 7..5 of the first byte.
constexpr std::uint8_t kDownloadSegmentRequest = 0;
constexpr std::uint8_t kDownloadRequest = 1;
constexpr std::uint8_t kUploadRequest = 2;
constexpr std::uint8_t kUploadSegmentRequest = 3;
constexpr std::uint8_t kAbortRequest = 4;
constexpr std::uint8_t kBlockUploadRequest = 5;
constexpr std::uint8_t kBlockDownloadRequest = 6;

constexpr std::uint8_t kExpedited = 0x02;
constexpr std::uint8_t kSizeIndicated = 0x01;
constexpr std::uint8_t kToggle = 0x10;
constexpr std::uint8_t kLastSegment = 0x01;
constexpr std::uint8_t kAbortCommand = 0x80;
constexpr int kSegmentsPerTurn = 4;  // of a block upload

}  // namespace

void SdoServer::reset(std::uint32_t request_id, std::uint32_t response_id) {
  finish();
  has_unsent_ = false;
  request_id_ = request_id;
  response_id_ = response_id;
}

void SdoServer::handle(const CanFrame& frame, std::uint64_t now_us) {
  if (frame.len != 8 || frame.is(kFrameRemote) || frame.is(kFrameFd)) return;
  now_us_ = now_us;
  last_activity_us_ = now_us;
  nudged_ = false;
  // During a sub-block every first byte is a sequence number, except that of an abort.
  if (state_ == State::kBlockDownload && frame.data[0] != kAbortCommand) {
    block_download_segment(frame.data);
  } else if (!is_last_segment_again(frame.data)) {
    handle_command(frame.data);
  }
}

void SdoServer::handle_command(const std::uint8_t* request) {
  switch (request[0] >> 5) {
    case kDownloadRequest:
      return initiate_download(request);
    case kDownloadSegmentRequest:
      return download_segment(request);
    case kUploadRequest:
      return initiate_upload(request);
    case kUploadSegmentRequest:
      return upload_segment(request);
    case kAbortRequest:
      return finish();
    case kBlockDownloadRequest:
      return handle_block_download(request);
    case kBlockUploadRequest:
      return handle_block_upload(request);
    default:
      // The standard has no such command: the abort names the object that the frame seems to mean.
      if (state_ == State::kIdle) take_multiplexer(request);
      return abort(Abort::kCommandSpecifier);
  }
}

void SdoServer::initiate_download(const std::uint8_t* request) {
  finish();
  take_multiplexer(request);
  const bool expedited = (request[0] & kExpedited) != 0;
  const bool sized = (request[0] & kSizeIndicated) != 0;
  std::uint32_t size = kUnknownSize;
  if (sized) {
    size = expedited ? 4U - ((request[0] >> 2) & 3U) : announced_size(request);
  }
  std::uint32_t expected = 0;
  if (const Abort code = access_.begin_write(index_, sub_, size, expected); code != Abort::kNone) {
    return abort(code);
  }
  if (expedited) {
    // Without an indicated size, the object's size tells how many of the four bytes are data.
    const std::size_t length =
        sized ? size : (expected == 0 ? 4U : std::min<std::uint32_t>(expected, 4));
    if (const Abort code = access_.append({request + 4, length}); code != Abort::kNone) {
      return abort(code);
    }
    if (const Abort code = access_.finish_write(); code != Abort::kNone) return abort(code);
  } else {
    state_ = State::kDownloadSegment;
    toggle_ = false;
  }
  respond(response(0x60));
}

void SdoServer::download_segment(const std::uint8_t* request) {
  if (state_ != State::kDownloadSegment) return abort(Abort::kCommandSpecifier);
  if (((request[0] & kToggle) != 0) != toggle_) return abort(Abort::kToggleBit);
  const std::size_t length = kSegmentBytes - ((request[0] >> 1) & 7U);
  if (const Abort code = access_.append({request + 1, length}); code != Abort::kNone) {
    return abort(code);
  }
  Payload answer = {};
  answer[0] = static_cast<std::uint8_t>(0x20U | (toggle_ ? kToggle : 0U));
  toggle_ = !toggle_;
  if ((request[0] & kLastSegment) != 0) {
    if (const Abort code = access_.finish_write(); code != Abort::kNone) return abort(code);
    finish();
  }
  respond(answer);
}

void SdoServer::initiate_upload(const std::uint8_t* request) {
  finish();
  take_multiplexer(request);
  if (const Abort code = access_.begin_read(index_, sub_, size_); code != Abort::kNone) {
    return abort(code);
  }
  respond_upload_initiated();
}

void SdoServer::respond_upload_initiated() {
  offset_ = 0;
  if (size_ >= 1 && size_ <= 4) {
    Payload answer = response(static_cast<std::uint8_t>(0x43U | (4U - size_) << 2));
    access_.read(0, std::span(answer).subspan(4, size_));
    return respond(answer);
  }
  Payload answer = response(0x41);
  store_le(&answer[4], size_);
  state_ = State::kUploadSegment;
  toggle_ = false;
  respond(answer);
}

void SdoServer::upload_segment(const std::uint8_t* request) {
  if (state_ != State::kUploadSegment) return abort(Abort::kCommandSpecifier);
  if (((request[0] & kToggle) != 0) != toggle_) return abort(Abort::kToggleBit);
  Payload answer = {};
  const std::size_t length = std::min<std::size_t>(kSegmentBytes, size_ - offset_);
  access_.read(offset_, std::span(answer).subspan(1, length));
  offset_ += static_cast<std::uint32_t>(length);
  const bool last = offset_ == size_;
  answer[0] = static_cast<std::uint8_t>((toggle_ ? kToggle : 0U) | (kSegmentBytes - length) << 1 |
                                        (last ? kLastSegment : 0U));
  toggle_ = !toggle_;
  if (last) finish();
  respond(answer);
}

void SdoServer::process(std::uint64_t now_us, bool at_rest) {
  now_us_ = now_us;
  if (has_unsent_ && transmit(unsent_)) has_unsent_ = false;
  if (state_ == State::kIdle) return;
  const std::uint64_t silence_us = now_us - last_activity_us_;
  if (silence_us >= kTimeOutUs) return abort(Abort::kTimeOut);
  // The last segment of a sub-block may be lost: acknowledge once what has arrived.
  if (state_ == State::kBlockDownload && !nudged_ && sequence_ > 0 &&
      silence_us >= kTimeOutUs / 2) {
    nudged_ = true;
    acknowledge_sub_block();
  }
  int segments = at_rest ? kSegmentsPerTurn : (silence_us >= kSegmentPauseUs ? 1 : 0);
  while (segments > 0 && send_block_segment()) --segments;
}

std::uint32_t SdoServer::announced_size(const std::uint8_t* request) {
  return std::min(load_le<std::uint32_t>(request + 4), kUnknownSize - 1);
}

void SdoServer::take_multiplexer(const std::uint8_t* request) {
  index_ = load_le<std::uint16_t>(request + 1);
  sub_ = request[3];
}

SdoServer::Payload SdoServer::response(std::uint8_t command) const {
  Payload payload = {};
  payload[0] = command;
  store_le(&payload[1], index_);
  payload[3] = sub_;
  return payload;
}

bool SdoServer::transmit(const Payload& payload) {
  CanFrame frame;
  frame.id = response_id_;
  frame.len = 8;
  std::memcpy(frame.data, payload.data(), payload.size());
  return port_.send(frame);
}

void SdoServer::respond(const Payload& payload) {
  unsent_ = payload;
  has_unsent_ = !transmit(payload);
}

void SdoServer::abort(Abort code) {
  Payload payload = response(kAbortCommand);
  store_le(&payload[4], static_cast<std::uint32_t>(code));
  finish();
  respond(payload);
}

void SdoServer::finish() {
  access_.cancel();
  state_ = State::kIdle;
}

}  // namespace armtrue::canopen
