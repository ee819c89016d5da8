// The client's half of the SDO protocols, frame by frame, towards a NodeBench. For tests.
#ifndef ARMTRUE_FIRMWARE_TESTING_SDO_PEER_H_
#define ARMTRUE_FIRMWARE_TESTING_SDO_PEER_H_

#include <algorithm>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <vector>

#include "firmware/canopen/protocol/crc16.h"
#include "firmware/testing/node_bench.h"

namespace armtrue::canopen {

enum class Transfer : std::uint8_t {
  kSegmentedDownload,
  kSegmentedUpload,
  kBlockDownload,
  kBlockUpload
};
inline constexpr Transfer kTransfers[] = {Transfer::kSegmentedDownload, Transfer::kSegmentedUpload,
                                          Transfer::kBlockDownload, Transfer::kBlockUpload};

// Test data; other sizes have other bytes at the same places.
inline std::vector<std::uint8_t> sdo_pattern(std::size_t size) {
  std::vector<std::uint8_t> bytes(size);
  for (std::size_t k = 0; k < size; ++k) bytes[k] = static_cast<std::uint8_t>(k * 31 + size);
  return bytes;
}

// Transfers with 0x2010, the staging image. Throws std::runtime_error at the first wrong answer.
class SdoPeer {
 public:
  explicit SdoPeer(NodeBench& bench) : bench_(bench) {}

  // The frames that a client sends for a whole transfer of `data` (5 to 889 bytes), in order; they
  // do not depend on the answers.
  static std::vector<CanFrame> requests(Transfer transfer, std::span<const std::uint8_t> data) {
    const std::size_t segments = (data.size() + 6) / 7;
    const auto size = static_cast<int>(data.size());
    const int unused = static_cast<int>(7 * segments - data.size());
    std::vector<CanFrame> frames;
    switch (transfer) {
      case Transfer::kSegmentedDownload:
        frames.push_back(request({0x21, 0x10, 0x20, 0, size & 0xFF, size >> 8, 0, 0}));
        for (std::size_t k = 0; k < segments; ++k) {
          const bool last = k + 1 == segments;
          const int toggle = k % 2 == 0 ? 0 : 0x10;
          frames.push_back(segment(toggle | (last ? unused << 1 | 1 : 0), data, k));
        }
        break;
      case Transfer::kSegmentedUpload:
        frames.push_back(request({0x40, 0x10, 0x20, 0, 0, 0, 0, 0}));
        for (std::size_t k = 0; k < segments; ++k) {
          frames.push_back(request({k % 2 == 0 ? 0x60 : 0x70, 0, 0, 0, 0, 0, 0, 0}));
        }
        break;
      case Transfer::kBlockDownload: {
        frames.push_back(request({0xC6, 0x10, 0x20, 0, size & 0xFF, size >> 8, 0, 0}));
        for (std::size_t k = 0; k < segments; ++k) {
          frames.push_back(
              segment(static_cast<int>(k + 1) | (k + 1 == segments ? 0x80 : 0), data, k));
        }
        const int crc = crc16(data);
        frames.push_back(request({0xC1 | unused << 2, crc & 0xFF, crc >> 8, 0, 0, 0, 0, 0}));
        break;
      }
      case Transfer::kBlockUpload:
        frames.push_back(request({0xA4, 0x10, 0x20, 0, 127, 0, 0, 0}));
        frames.push_back(request({0xA3, 0, 0, 0, 0, 0, 0, 0}));
        frames.push_back(request({0xA2, static_cast<int>(segments), 127, 0, 0, 0, 0, 0}));
        frames.push_back(request({0xA1, 0, 0, 0, 0, 0, 0, 0}));
        break;
    }
    return frames;
  }

  void download_block(std::span<const std::uint8_t> data) {
    const auto size = static_cast<int>(data.size());
    expect(bench_.ask({0xC6, 0x10, 0x20, 0, size & 0xFF, size >> 8, 0, 0})[0] == 0xA4);
    const std::size_t segments = (data.size() + 6) / 7;
    for (std::size_t done = 0; done < segments;) {
      const std::size_t count = std::min<std::size_t>(127, segments - done);
      for (std::size_t k = 0; k < count; ++k) {
        const bool last = done + k + 1 == segments;
        bench_.from_controller(
            segment(static_cast<int>(k + 1) | (last ? 0x80 : 0), data, done + k));
      }
      const CanFrame answer = only_answer();
      expect(answer.data[0] == 0xA2 && answer.data[1] == count);
      done += count;
    }
    const int unused = static_cast<int>(7 * segments - data.size());
    const int crc = crc16(data);
    expect(bench_.ask({0xC1 | unused << 2, crc & 0xFF, crc >> 8, 0, 0, 0, 0, 0})[0] == 0xA1);
  }

  std::vector<std::uint8_t> upload_segmented() {
    const auto first = bench_.ask({0x40, 0x10, 0x20, 0, 0, 0, 0, 0});
    if ((first[0] & 0x02) != 0) return {first.begin() + 4, first.end() - (first[0] >> 2 & 3)};
    expect(first[0] == 0x41);
    std::vector<std::uint8_t> data;
    for (int toggle = 0;; toggle ^= 0x10) {
      const auto answer = bench_.ask({0x60 | toggle, 0, 0, 0, 0, 0, 0, 0});
      expect((answer[0] & 0xF0) == toggle);
      data.insert(data.end(), answer.begin() + 1, answer.end() - (answer[0] >> 1 & 7));
      if ((answer[0] & 1) != 0) break;
    }
    expect(data.size() == load_le<std::uint32_t>(&first[4]));
    return data;
  }

  std::vector<std::uint8_t> upload_block() {
    const auto first = bench_.ask({0xA4, 0x10, 0x20, 0, 127, 0, 0, 0});
    expect((first[0] & 0xE3) == 0xC2);
    bench_.from_controller(request({0xA3, 0, 0, 0, 0, 0, 0, 0}));
    std::vector<std::uint8_t> data;
    for (;;) {
      const std::vector<CanFrame> frames = bench_.all_sent();
      expect(!frames.empty());
      if (frames.size() == 1 && (frames[0].data[0] & 0xE3) == 0xC1) {
        data.resize(data.size() - (frames[0].data[0] >> 2 & 7));
        expect(load_le<std::uint16_t>(&frames[0].data[1]) == crc16(data));
        break;
      }
      for (std::size_t k = 0; k < frames.size(); ++k) {
        expect((frames[k].data[0] & 0x7F) == k + 1);
        data.insert(data.end(), frames[k].data + 1, frames[k].data + 8);
      }
      bench_.from_controller(request({0xA2, static_cast<int>(frames.size()), 127, 0, 0, 0, 0, 0}));
    }
    bench_.from_controller(request({0xA1, 0, 0, 0, 0, 0, 0, 0}));
    expect(data.size() == load_le<std::uint32_t>(&first[4]));
    return data;
  }

  // Downloads and uploads `size` bytes, segmented and in blocks, and compares them.
  void transfer_every_way(std::size_t size) {
    const std::vector<std::uint8_t> data = sdo_pattern(size);
    expect(bench_.stage(data) == 0 && upload_block() == data);
    const std::vector<std::uint8_t> other(data.rbegin(), data.rend());
    download_block(other);
    expect(upload_segmented() == other);
  }

 private:
  static CanFrame request(std::initializer_list<int> bytes) {
    return make_frame(0x600 + NodeBench::kNodeId, bytes);
  }
  static CanFrame segment(int command, std::span<const std::uint8_t> data, std::size_t number) {
    CanFrame frame = request({command, 0, 0, 0, 0, 0, 0, 0});
    const auto piece = data.subspan(7 * number, std::min<std::size_t>(7, data.size() - 7 * number));
    std::copy(piece.begin(), piece.end(), frame.data + 1);
    return frame;
  }
  CanFrame only_answer() {
    const std::vector<CanFrame> frames = bench_.upstream.take_sent();
    expect(frames.size() == 1);
    return frames[0];
  }
  static void expect(bool condition) {
    if (!condition) throw std::runtime_error("a wrong answer, or none");
  }

  NodeBench& bench_;
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_TESTING_SDO_PEER_H_
