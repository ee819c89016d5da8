// Whole transfers of many sizes, and transfers disturbed at each of their steps.
#include <gtest/gtest.h>

#include <cstdio>

#include "firmware/testing/sdo_peer.h"

namespace armtrue::canopen {
namespace {

TEST(SdoTransfers, TransfersOfManySizes_ReadBackAsWritten) {
  NodeBench bench(false);
  SdoPeer peer(bench);
  // Every size to beyond a full block of 127 segments, then samples (canopen_sizes: all sizes).
  for (std::size_t size = 1; size <= kMaxImageLength; size += size < 900 ? 1 : 509) {
    ASSERT_NO_THROW(peer.transfer_every_way(size)) << size;
  }
  ASSERT_NO_THROW(peer.transfer_every_way(kMaxImageLength));
  EXPECT_THROW(peer.transfer_every_way(kMaxImageLength + 1), std::runtime_error);
}

// A bridge between buses may repeat a frame. By its number, the last segment's first byte can equal
// that of an abort (1 to 31), of an end (65, 69 …) or of no command (96 to 127).
TEST(SdoTransfers, RepeatedBlockSegment_IsTakenOnce) {
  NodeBench bench(false);
  for (std::size_t segments = 1; segments <= 127; ++segments) {
    const std::vector<std::uint8_t> data = sdo_pattern(7 * segments - 2);
    const std::vector<CanFrame> requests = SdoPeer::requests(Transfer::kBlockDownload, data);
    std::vector<std::uint8_t> answers;
    for (std::size_t k = 0; k < requests.size(); ++k) {
      bench.from_controller(requests[k]);
      const bool is_segment = k > 0 && k + 1 < requests.size();
      if (is_segment) bench.from_controller(requests[k]);
      for (const CanFrame& frame : bench.upstream.take_sent()) {
        if (frame.id == 0x580 + NodeBench::kNodeId) answers.push_back(frame.data[0]);
      }
    }
    EXPECT_EQ(answers, (std::vector<std::uint8_t>{0xA4, 0xA2, 0xA1})) << segments;
    EXPECT_EQ(bench.read(0x2013, 3), data.size());
  }
}

enum class Trouble : std::uint8_t { kAbort, kSilence, kOtherRequest, kReset, kWrongFrame };
constexpr Trouble kTroubles[] = {Trouble::kAbort, Trouble::kSilence, Trouble::kOtherRequest,
                                 Trouble::kReset, Trouble::kWrongFrame};

// The abort codes among the sent frames; other responses of the transfer are skipped.
std::vector<std::uint32_t> aborts_in(const std::vector<CanFrame>& frames) {
  std::vector<std::uint32_t> codes;
  for (const CanFrame& frame : frames) {
    if (frame.id == 0x580 + NodeBench::kNodeId && frame.data[0] == 0x80) {
      codes.push_back(load_le<std::uint32_t>(&frame.data[4]));
    }
  }
  return codes;
}

class TroubledTransfer : public testing::Test {
 protected:
  // `in_block`: segments of a block download are being awaited.
  void trouble(Trouble kind, bool in_block) {
    switch (kind) {
      case Trouble::kAbort:
        bench.from_controller(make_frame(0x620, {0x80, 0x10, 0x20, 0, 0, 0, 0, 8}));
        EXPECT_TRUE(bench.upstream.take_sent().empty()) << "an abort is not answered";
        break;
      case Trouble::kSilence:
        bench.run_for(SdoServer::kTimeOutUs + 2000);
        EXPECT_EQ(aborts_in(bench.upstream.take_sent()), std::vector<std::uint32_t>{0x05040000});
        break;
      case Trouble::kOtherRequest:
        if (in_block) {
          // Every frame is a segment there, 0x40 the sixty-fourth: out of order, and not taken.
          bench.from_controller(make_frame(0x620, {0x40, 0x17, 0x10, 0, 0, 0, 0, 0}));
          EXPECT_TRUE(bench.upstream.take_sent().empty());
          bench.run_for(SdoServer::kTimeOutUs + 2000);
          EXPECT_EQ(aborts_in(bench.upstream.take_sent()).size(), 1U);
        } else {
          EXPECT_EQ(bench.read(0x1017, 0), 0U) << "answered, and the transfer is over";
        }
        break;
      case Trouble::kReset:
        bench.from_controller(make_frame(0x000, {0x82, 0}));
        bench.run_for(1000);
        EXPECT_TRUE(aborts_in(bench.upstream.take_sent()).empty());
        break;
      case Trouble::kWrongFrame:
        // No valid command; as a segment, its number is beyond the block.
        bench.from_controller(make_frame(0x620, {0xE0, 0, 0, 0, 0, 0, 0, 0}));
        bench.run_for(SdoServer::kTimeOutUs + 2000);
        EXPECT_EQ(aborts_in(bench.upstream.take_sent()).size(), 1U);
        break;
    }
  }

  NodeBench bench{false};
};

TEST_F(TroubledTransfer, AtEveryStep_LeavesNoPartOfATransfer) {
  const std::vector<std::uint8_t> before = sdo_pattern(33);
  const std::vector<std::uint8_t> data = sdo_pattern(40);
  SdoPeer peer(bench);
  std::size_t cases = 0;
  for (const Transfer transfer : kTransfers) {
    const bool is_upload =
        transfer == Transfer::kSegmentedUpload || transfer == Transfer::kBlockUpload;
    const std::vector<CanFrame> requests = SdoPeer::requests(transfer, data);
    for (const Trouble kind : kTroubles) {
      for (std::size_t sent = 1; sent < requests.size(); ++sent) {
        const auto where = [&] {
          return testing::Message() << "transfer " << int(transfer) << ", trouble " << int(kind)
                                    << ", after " << sent << " frames";
        };
        ASSERT_EQ(bench.stage(is_upload ? data : before), 0U) << where();
        for (std::size_t k = 0; k < sent; ++k) {
          bench.from_controller(requests[k]);
          bench.all_sent();
        }
        trouble(kind, transfer == Transfer::kBlockDownload && sent + 1 < requests.size());
        // A reader finds all of the staged bytes, or none.
        EXPECT_EQ(bench.read(0x2013, 3), is_upload ? data.size() : 0U) << where();
        EXPECT_EQ(bench.read(0x2013, 1), is_upload ? 2U : 0U) << where();
        ASSERT_NO_THROW(peer.transfer_every_way(40)) << where();
        ASSERT_FALSE(HasFailure()) << where();
        ++cases;
      }
    }
  }
  std::printf("[ COUNT    ] transfers disturbed: %zu\n", cases);
  EXPECT_EQ(cases, 5U * (6 + 6 + 7 + 3));
}

}  // namespace
}  // namespace armtrue::canopen
