// SDO server (CiA 301, 7.2.4.3): expedited, segmented and block transfer in both directions.
//
// Requests are passed to handle(); answers leave through `port`. process() checks the time-out and
// sends the segments of block uploads: none while the port has a backlog, and one per millisecond
// while joints are commanded, because frames leave in order and would delay those of the joints.
//
//   expedited   request   ccs 1 | n | e=1 | s   index sub   data[4]
//   segmented   initiate  ccs 1 | e=0 | s       index sub   size[4]
//               segment   ccs 0 | t | n | c     data[7]
//   block       initiate  ccs 6 | cc | s        index sub   size[4]
//               segment   c | seqno             data[7]
//               end       ccs 6 | n | 01        crc[2]
#ifndef ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_SDO_SERVER_H_
#define ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_SDO_SERVER_H_

#include <array>
#include <cstdint>

#include "firmware/canopen/protocol/can_port.h"
#include "firmware/canopen/protocol/dictionary_access.h"

namespace armtrue::canopen {

class SdoServer {
 public:
  SdoServer(CanPort& port, DictionaryAccess& access) : port_(port), access_(access) {}

  // Back to idle, with these identifiers (11 bit).
  void reset(std::uint32_t request_id, std::uint32_t response_id);

  // Takes a frame with the request identifier. A frame whose length is not 8 is no SDO and ignored.
  void handle(const CanFrame& frame, std::uint64_t now_us);

  // `at_rest`: no joints are commanded.
  void process(std::uint64_t now_us, bool at_rest);

  std::uint32_t request_id() const { return request_id_; }

  // Silence after which a transfer is aborted.
  static constexpr std::uint64_t kTimeOutUs = 2'000'000;
  // Pause between two segments of a block upload while joints are commanded.
  static constexpr std::uint64_t kSegmentPauseUs = 1000;

 private:
  static constexpr std::size_t kSegmentBytes = 7;
  enum class State : std::uint8_t {
    kIdle,
    kDownloadSegment,
    kUploadSegment,
    kBlockDownload,        // segments of a sub-block arrive
    kBlockDownloadEnd,     // all segments are here, the end with the CRC is not
    kBlockUploadStart,     // initiated, waits for the client's start
    kBlockUploadSegments,  // segments of a sub-block leave
    kBlockUploadAck,       // a sub-block has left, its acknowledgement is awaited
    kBlockUploadEnd,       // the end has been sent
  };
  using Payload = std::array<std::uint8_t, 8>;

  void handle_command(const std::uint8_t* request);
  void initiate_download(const std::uint8_t* request);
  void download_segment(const std::uint8_t* request);
  void initiate_upload(const std::uint8_t* request);
  void upload_segment(const std::uint8_t* request);
  void respond_upload_initiated();

  void handle_block_download(const std::uint8_t* request);
  void initiate_block_download(const std::uint8_t* request);
  void block_download_segment(const std::uint8_t* segment);
  void acknowledge_sub_block();
  bool is_last_segment_again(const std::uint8_t* request) const;
  void end_block_download(const std::uint8_t* request);
  void handle_block_upload(const std::uint8_t* request);
  void initiate_block_upload(const std::uint8_t* request);
  // Sends one segment if one is due and the port has room. Returns whether it did.
  bool send_block_segment();
  void block_upload_acknowledged(const std::uint8_t* request);

  // The size in an initiate request, at most kUnknownSize - 1, so that no request's size counts as
  // "not announced". Both sizes are far too large.
  static std::uint32_t announced_size(const std::uint8_t* request);
  void take_multiplexer(const std::uint8_t* request);
  Payload response(std::uint8_t command) const;
  void respond(const Payload& payload);
  bool transmit(const Payload& payload);
  void abort(Abort code);
  void finish();

  CanPort& port_;
  DictionaryAccess& access_;
  std::uint32_t request_id_ = 0;
  std::uint32_t response_id_ = 0;
  State state_ = State::kIdle;
  std::uint16_t index_ = 0;
  std::uint8_t sub_ = 0;
  bool toggle_ = false;
  std::uint32_t size_ = 0;    // of an upload
  std::uint32_t offset_ = 0;  // bytes of an upload that have been sent (block: acknowledged)
  std::uint64_t last_activity_us_ = 0;
  std::uint64_t now_us_ = 0;
  Payload unsent_ = {};  // a response that the port had no room for
  bool has_unsent_ = false;

  // Block transfer.
  std::uint8_t block_size_ = 0;
  std::uint8_t sequence_ = 0;  // last segment accepted or sent in this sub-block
  bool with_crc_ = false;
  bool last_segment_seen_ = false;
  bool nudged_ = false;  // the sub-block was acknowledged early because the client went silent
  std::uint16_t crc_ = 0;
  std::uint32_t crc_end_ = 0;  // crc_ covers the bytes of an upload before this one
  // The newest segment; the end request tells how many of its bytes are data.
  std::array<std::uint8_t, 7> held_ = {};
  bool has_held_ = false;
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_SDO_SERVER_H_
