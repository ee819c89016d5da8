// Responses of the SDO server, byte by byte and in every state, to the frames of a client.
#include "firmware/canopen/sdo/sdo_server.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <utility>

#include "firmware/canopen/protocol/crc16.h"
#include "firmware/testing/node_bench.h"

namespace armtrue::canopen {
namespace {

using Answer = std::array<std::uint8_t, 8>;

std::uint32_t abort_of(const Answer& answer) {
  return answer[0] == 0x80 ? load_le<std::uint32_t>(&answer[4]) : 0;
}

std::vector<std::uint8_t> pattern(std::size_t size) {
  std::vector<std::uint8_t> bytes(size);
  for (std::size_t k = 0; k < size; ++k) bytes[k] = static_cast<std::uint8_t>(k * 31 + size);
  return bytes;
}

class SdoTest : public testing::Test {
 protected:
  SdoTest() : bench(false) { bench.upstream.take_sent(); }

  void send(std::initializer_list<int> bytes) { bench.from_controller(make_frame(0x620, bytes)); }
  std::vector<CanFrame> answers() { return bench.upstream.take_sent(); }

  // One sub-block of a block download, segments numbered from 1; `skip`: segments not sent.
  void send_segments(const std::vector<std::uint8_t>& data, std::size_t first, int count, bool ends,
                     int skip = 0) {
    for (int k = 1; k <= count; ++k) {
      if (k == skip) continue;
      CanFrame frame;
      frame.id = 0x620;
      frame.len = 8;
      frame.data[0] = static_cast<std::uint8_t>(k | (ends && k == count ? 0x80 : 0));
      for (std::size_t byte = 0; byte < 7; ++byte) {
        const std::size_t at = 7 * (first + static_cast<std::size_t>(k) - 1) + byte;
        frame.data[1 + byte] = at < data.size() ? data[at] : std::uint8_t{0};
      }
      bench.from_controller(frame);
    }
  }
  void end_block(const std::vector<std::uint8_t>& data, std::uint16_t crc) {
    const auto unused = static_cast<int>((7 - data.size() % 7) % 7);
    send({0xC1 | unused << 2, crc & 0xFF, crc >> 8, 0, 0, 0, 0, 0});
  }

  NodeBench bench;
};

TEST_F(SdoTest, EachString_IsReadFromItsOwnMemory) {
  EXPECT_EQ(bench.read(0x1009, 0), '1') << "hardware version, behind the device's name in memory";
}

TEST_F(SdoTest, ExpeditedDownload_EndsAnOpenUpload) {
  EXPECT_EQ(bench.ask({0x40, 0x08, 0x10, 0, 0, 0, 0, 0})[0], 0x41) << "in segments";
  EXPECT_EQ(bench.write(0x2000, 5, 500, 4), 0U);
  EXPECT_EQ(abort_of(bench.ask({0x60, 0, 0, 0, 0, 0, 0, 0})), 0x05040001U);
}

TEST_F(SdoTest, ExpeditedUpload_StatesItsNumberOfBytes) {
  EXPECT_EQ(bench.ask({0x40, 0x00, 0x10, 0, 0, 0, 0, 0}),
            (Answer{0x43, 0x00, 0x10, 0, 0x92, 0x01, 0xFF, 0xFF}));
  EXPECT_EQ(bench.ask({0x40, 0x17, 0x10, 0, 0, 0, 0, 0})[0], 0x4B);
  EXPECT_EQ(bench.ask({0x40, 0x01, 0x10, 0, 0, 0, 0, 0})[0], 0x4F);
}

TEST_F(SdoTest, AnAnswer_NamesTheObjectAndItsSubIndex) {
  EXPECT_EQ(bench.ask({0x00, 1, 2, 3, 4, 5, 6, 7}), (Answer{0x80, 0, 0, 0, 1, 0, 4, 5}))
      << "no object has been named yet";
  EXPECT_EQ(bench.ask({0x40, 0x18, 0x10, 4, 0, 0, 0, 0}),
            (Answer{0x43, 0x18, 0x10, 4, 7, 0, 0, 0}));
  EXPECT_EQ(bench.ask({0x40, 0x18, 0x10, 9, 0, 0, 0, 0}),
            (Answer{0x80, 0x18, 0x10, 9, 0x11, 0x00, 0x09, 0x06}));
}

TEST_F(SdoTest, ExpeditedDownloadWithoutSize_HasTheObjectsSize) {
  EXPECT_EQ(bench.ask({0x22, 0x17, 0x10, 0, 0xE8, 0x03, 0xAA, 0xBB})[0], 0x60);
  EXPECT_EQ(bench.read(0x1017, 0), 1000U);
}

TEST_F(SdoTest, SegmentedUpload_TogglesAndMarksTheLastSegment) {
  EXPECT_EQ(bench.ask({0x40, 0x08, 0x10, 0, 0, 0, 0, 0}),
            (Answer{0x41, 0x08, 0x10, 0, 19, 0, 0, 0}));
  std::string text;
  for (int k = 0; k < 3; ++k) {
    const Answer segment = bench.ask({0x60 | (k & 1) << 4, 0, 0, 0, 0, 0, 0, 0});
    EXPECT_EQ(segment[0] & 0x10, (k & 1) << 4);
    EXPECT_EQ(segment[0] & 1, k == 2);
    text.append(segment.begin() + 1, segment.end() - (segment[0] >> 1 & 7));
  }
  EXPECT_EQ(text, "Armtrue compensator");
}

TEST_F(SdoTest, AWrongToggleBitAborts) {
  bench.ask({0x40, 0x08, 0x10, 0, 0, 0, 0, 0});
  EXPECT_EQ(abort_of(bench.ask({0x70, 0, 0, 0, 0, 0, 0, 0})), 0x05030000U);
  bench.ask({0x21, 0x10, 0x20, 0, 20, 0, 0, 0});
  EXPECT_EQ(abort_of(bench.ask({0x10, 1, 2, 3, 4, 5, 6, 7})), 0x05030000U);
  EXPECT_EQ(bench.read(0x2013, 1), 0U) << "the staging buffer is empty again";
}

TEST_F(SdoTest, SegmentsWithoutTransferAndUnknownCommands_Abort) {
  EXPECT_EQ(abort_of(bench.ask({0x00, 0, 0, 0, 0, 0, 0, 0})), 0x05040001U);
  EXPECT_EQ(abort_of(bench.ask({0x60, 0, 0, 0, 0, 0, 0, 0})), 0x05040001U);
  EXPECT_EQ(abort_of(bench.ask({0xA2, 0, 0, 0, 0, 0, 0, 0})), 0x05040001U);
  EXPECT_EQ(abort_of(bench.ask({0xC1, 0, 0, 0, 0, 0, 0, 0})), 0x05040001U);
  EXPECT_EQ(bench.ask({0xE0, 0x00, 0x10, 0, 0, 0, 0, 0}),
            (Answer{0x80, 0x00, 0x10, 0, 0x01, 0x00, 0x04, 0x05}));
}

TEST_F(SdoTest, FramesNotOfEightBytes_AreIgnored) {
  send({0x40, 0x00, 0x10, 0, 0, 0, 0});
  EXPECT_TRUE(answers().empty());
}

TEST_F(SdoTest, ASegmentedDownloadMustKeepItsAnnouncedSize) {
  bench.ask({0x21, 0x10, 0x20, 0, 10, 0, 0, 0});
  bench.ask({0x00, 1, 2, 3, 4, 5, 6, 7});
  EXPECT_EQ(abort_of(bench.ask({0x10, 1, 2, 3, 4, 5, 6, 7})), 0x06070012U);
  bench.ask({0x21, 0x10, 0x20, 0, 10, 0, 0, 0});
  EXPECT_EQ(abort_of(bench.ask({0x01, 1, 2, 3, 4, 5, 6, 7})), 0x06070010U);
}

TEST_F(SdoTest, ANewRequestReplacesATransfer) {
  bench.ask({0x21, 0x10, 0x20, 0, 20, 0, 0, 0});
  EXPECT_EQ(bench.read(0x1000, 0), 0xFFFF0192U);
  EXPECT_EQ(abort_of(bench.ask({0x00, 1, 2, 3, 4, 5, 6, 7})), 0x05040001U);
}

TEST_F(SdoTest, ASilentClientIsTimedOut) {
  bench.ask({0x21, 0x10, 0x20, 0, 20, 0, 0, 0});
  bench.run_for(SdoServer::kTimeOutUs - 1000);
  EXPECT_TRUE(answers().empty());
  bench.run_for(2000);
  const std::vector<CanFrame> sent = answers();
  ASSERT_EQ(sent.size(), 1U);
  EXPECT_EQ(load_le<std::uint32_t>(&sent[0].data[4]), 0x05040000U);
}

TEST_F(SdoTest, AResponseWaitsForRoomOnTheBus) {
  bench.upstream.set_room(0);
  send({0x40, 0x00, 0x10, 0, 0, 0, 0, 0});
  bench.upstream.set_room(8);
  bench.turn();
  ASSERT_EQ(answers().size(), 1U);
}

TEST_F(SdoTest, StoppedNode_AnswersNoSdo) {
  bench.nmt(2, 0);
  send({0x40, 0x00, 0x10, 0, 0, 0, 0, 0});
  EXPECT_TRUE(answers().empty());
}

class BlockDownloadTest : public SdoTest, public testing::WithParamInterface<std::size_t> {};

TEST_P(BlockDownloadTest, ArrivesWithItsCrcAndReadsBack) {
  const std::vector<std::uint8_t> data = pattern(GetParam());
  const auto size = static_cast<int>(data.size());
  const Answer first = bench.ask({0xC6, 0x10, 0x20, 0, size & 0xFF, size >> 8, 0, 0});
  ASSERT_EQ(first, (Answer{0xA4, 0x10, 0x20, 0, 127, 0, 0, 0}));
  const std::size_t segments = (data.size() + 6) / 7;
  for (std::size_t done = 0; done < segments; done += 127) {
    const auto count = static_cast<int>(std::min<std::size_t>(127, segments - done));
    send_segments(data, done, count, done + static_cast<std::size_t>(count) == segments);
    const std::vector<CanFrame> sent = answers();
    ASSERT_EQ(sent.size(), 1U);
    EXPECT_EQ(sent[0].data[0], 0xA2);
    EXPECT_EQ(sent[0].data[1], count);
  }
  end_block(data, crc16(data));
  const std::vector<CanFrame> sent = answers();
  ASSERT_EQ(sent.size(), 1U);
  EXPECT_EQ(sent[0].data[0], 0xA1);
  EXPECT_EQ(bench.read(0x2013, 3), data.size());

  // Block upload in blocks of 50 segments; once the last two of a block are lost and sent again.
  ASSERT_EQ(bench.ask({0xA4, 0x10, 0x20, 0, 50, 0, 0, 0})[0], 0xC6);
  send({0xA3, 0, 0, 0, 0, 0, 0, 0});
  std::vector<std::uint8_t> back;
  bool lost_one = false;
  for (int turn = 0; turn < 1000; ++turn) {
    std::vector<CanFrame> block = bench.all_sent();
    ASSERT_FALSE(block.empty());
    if (block[0].data[0] == 0xC1 || (block[0].data[0] & 0xE3) == 0xC1) {
      back.resize(back.size() - (block[0].data[0] >> 2 & 7));
      EXPECT_EQ(load_le<std::uint16_t>(&block[0].data[1]), crc16(back));
      send({0xA1, 0, 0, 0, 0, 0, 0, 0});
      break;
    }
    std::size_t taken = block.size();
    if (!lost_one && taken > 2) {
      taken -= 2;
      lost_one = true;
    }
    for (std::size_t k = 0; k < taken; ++k) {
      EXPECT_EQ(block[k].data[0] & 0x7F, k + 1);
      back.insert(back.end(), block[k].data + 1, block[k].data + 8);
    }
    send({0xA2, static_cast<int>(taken), 50, 0, 0, 0, 0, 0});
  }
  EXPECT_EQ(back, data);
}

INSTANTIATE_TEST_SUITE_P(Sizes, BlockDownloadTest,
                         testing::Values(1, 6, 7, 8, 14, 888, 889, 890, 891, 1778, 16384));

TEST_F(SdoTest, BlockSize_IsLimitedToThePortsLongestBurst) {
  constexpr int kBurst = 32;
  bench.upstream.set_longest_burst(kBurst);
  const std::vector<std::uint8_t> data = pattern(std::size_t{7} * (2 * kBurst + 6));
  const auto size = static_cast<int>(data.size());
  ASSERT_EQ(bench.ask({0xC6, 0x10, 0x20, 0, size & 0xFF, size >> 8, 0, 0}),
            (Answer{0xA4, 0x10, 0x20, 0, kBurst, 0, 0, 0}));
  std::size_t done = 0;
  for (const int count : {kBurst, kBurst, 6}) {
    send_segments(data, done, count, count == 6);
    done += static_cast<std::size_t>(count);
    const std::vector<CanFrame> sent = answers();
    ASSERT_EQ(sent.size(), 1U);
    EXPECT_EQ(sent[0].data[1], count);
    EXPECT_EQ(sent[0].data[2], kBurst) << "of the next block";
  }
  end_block(data, crc16(data));
  EXPECT_EQ(answers()[0].data[0], 0xA1);
  EXPECT_EQ(bench.read(0x2013, 3), data.size());
}

TEST_F(SdoTest, LostBlockSegment_IsRequestedAgain) {
  const std::vector<std::uint8_t> data = pattern(70);
  bench.ask({0xC6, 0x10, 0x20, 0, 70, 0, 0, 0});
  send_segments(data, 0, 10, true, 4);
  std::vector<CanFrame> sent = answers();
  ASSERT_EQ(sent.size(), 1U);
  EXPECT_EQ(sent[0].data[1], 3) << "the last one in sequence";
  send_segments(data, 3, 7, true);
  sent = answers();
  ASSERT_EQ(sent.size(), 1U);
  EXPECT_EQ(sent[0].data[1], 7);
  end_block(data, crc16(data));
  EXPECT_EQ(answers()[0].data[0], 0xA1);
}

TEST_F(SdoTest, LostLastBlockSegment_IsRequestedAfterASilence) {
  for (const int segments : {10, 2}) {
    const int size = 7 * segments;
    bench.ask({0xC6, 0x10, 0x20, 0, size, 0, 0, 0});
    send_segments(pattern(static_cast<std::size_t>(size)), 0, segments, true, segments);
    EXPECT_TRUE(answers().empty());
    bench.run_for(SdoServer::kTimeOutUs / 2 + 1000);
    const std::vector<CanFrame> sent = answers();
    ASSERT_EQ(sent.size(), 1U);
    EXPECT_EQ(sent[0].data[0], 0xA2);
    EXPECT_EQ(sent[0].data[1], segments - 1);
    send({0x80, 0x10, 0x20, 0, 0, 0, 0, 8});
  }
}

TEST_F(SdoTest, WrongBlockCrc_AbortsAndEmptiesTheBuffer) {
  const std::vector<std::uint8_t> data = pattern(21);
  bench.ask({0xC6, 0x10, 0x20, 0, 21, 0, 0, 0});
  send_segments(data, 0, 3, true);
  answers();
  end_block(data, static_cast<std::uint16_t>(crc16(data) ^ 1));
  const std::vector<CanFrame> sent = answers();
  ASSERT_EQ(sent.size(), 1U);
  EXPECT_EQ(load_le<std::uint32_t>(&sent[0].data[4]), 0x05040004U);
  EXPECT_EQ(bench.read(0x2013, 1), 0U);
}

TEST_F(SdoTest, BlockSequenceNumbersOutOfRangeAbort) {
  bench.ask({0xC6, 0x10, 0x20, 0, 70, 0, 0, 0});
  send({0x00, 1, 2, 3, 4, 5, 6, 7});
  EXPECT_EQ(load_le<std::uint32_t>(&answers()[0].data[4]), 0x05040003U);
}

TEST_F(SdoTest, TheClientMayAbortInsideABlock) {
  const std::vector<std::uint8_t> data = pattern(70);
  bench.ask({0xC6, 0x10, 0x20, 0, 70, 0, 0, 0});
  send_segments(data, 0, 3, false);
  send({0x80, 0x10, 0x20, 0, 0, 0, 0, 8});
  EXPECT_TRUE(answers().empty());
  EXPECT_EQ(bench.read(0x2013, 1), 0U);
}

TEST_F(SdoTest, BlockUploadRefusesImpossibleBlockSizes) {
  EXPECT_EQ(abort_of(bench.ask({0xA4, 0x08, 0x10, 0, 0, 0, 0, 0})), 0x05040002U);
  EXPECT_EQ(abort_of(bench.ask({0xA4, 0x08, 0x10, 0, 128, 0, 0, 0})), 0x05040002U);
}

TEST_F(SdoTest, BlockUploadOfASmallObjectMaySwitchProtocol) {
  EXPECT_EQ(bench.ask({0xA4, 0x00, 0x10, 0, 127, 4, 0, 0})[0], 0x43);
}

TEST_F(SdoTest, EmptyBlockUpload_WithoutAllowedSwitch_StaysABlockUpload) {
  // The robot's serial is empty here. Threshold 0: the server may not change the protocol.
  const Answer begun = bench.ask({0xA4, 0x14, 0x20, 0, 127, 0, 0, 0});
  EXPECT_EQ(begun[0], 0xC6);
  EXPECT_EQ(load_le<std::uint32_t>(&begun[4]), 0U);
  send({0xA3, 0, 0, 0, 0, 0, 0, 0});
  const std::vector<CanFrame> segments = answers();
  ASSERT_EQ(segments.size(), 1U);
  EXPECT_EQ(segments[0].data[0], 0x81) << "segment 1, the last";
  const Answer end = bench.ask({0xA2, 1, 127, 0, 0, 0, 0, 0});
  EXPECT_EQ(end[0], 0xC1 | 7 << 2) << "none of its seven bytes counts";
  send({0xA1, 0, 0, 0, 0, 0, 0, 0});
  EXPECT_TRUE(answers().empty());
  EXPECT_EQ(bench.ask({0xA4, 0x14, 0x20, 0, 127, 1, 0, 0})[0], 0x41) << "allowed: segmented";
}

TEST_F(SdoTest, AcknowledgeOfMoreThanWasSent_Aborts) {
  ASSERT_EQ(bench.stage(pattern(70)), 0U);
  for (const auto& [acknowledged, code] :
       {std::pair{4, 0U}, std::pair{5, 0x05040003U}, std::pair{127, 0x05040003U}}) {
    bench.ask({0xA4, 0x10, 0x20, 0, 4, 0, 0, 0});
    send({0xA3, 0, 0, 0, 0, 0, 0, 0});
    ASSERT_EQ(answers().size(), 4U);
    send({0xA2, acknowledged, 4, 0, 0, 0, 0, 0});
    const std::vector<CanFrame> next = answers();
    ASSERT_FALSE(next.empty());
    if (code != 0) {
      EXPECT_EQ(next[0].data[0], 0x80);
      EXPECT_EQ(load_le<std::uint32_t>(&next[0].data[4]), code) << acknowledged;
    } else {
      EXPECT_EQ(next[0].data[0], 1) << "the next sub-block";
    }
    send({0x80, 0x10, 0x20, 0, 0, 0, 0, 8});
    answers();
  }
}

TEST_F(SdoTest, AnnouncedSizeOfAllOnes_IsRefusedAsTooLarge) {
  for (const int command : {0x21, 0xC6 /* with a CRC and a size */}) {
    const Answer table = bench.ask({command, 0x10, 0x20, 0, 0xFF, 0xFF, 0xFF, 0xFF});
    EXPECT_EQ(abort_of(table), 0x05040005U) << command;
    EXPECT_EQ(bench.read(0x2013, 1), 0U) << "nothing is being received";
    const Answer number = bench.ask({command, 0x17, 0x10, 0, 0xFF, 0xFF, 0xFF, 0xFF});
    EXPECT_EQ(abort_of(number), 0x06070012U) << command;
  }
}

TEST_F(SdoTest, BlockUploadGoesOnWhenTheQueueHasRoomAgain) {
  const std::vector<std::uint8_t> data = pattern(700);
  ASSERT_EQ(bench.stage(data), 0U);
  bench.ask({0xA4, 0x10, 0x20, 0, 127, 0, 0, 0});
  bench.upstream.set_room(10);
  send({0xA3, 0, 0, 0, 0, 0, 0, 0});
  std::size_t segments = 0;
  for (int turn = 0; turn < 30; ++turn) {
    segments += answers().size();
    bench.run_for(1000);
  }
  EXPECT_EQ(segments, 100U);
}

TEST_F(SdoTest, BlockUpload_SendsFourSegmentsPerTurn) {
  ASSERT_EQ(bench.stage(pattern(700)), 0U);
  bench.ask({0xA4, 0x10, 0x20, 0, 127, 0, 0, 0});
  send({0xA3, 0, 0, 0, 0, 0, 0, 0});
  EXPECT_EQ(answers().size(), 4U);
  bench.turn();
  EXPECT_EQ(answers().size(), 4U);
}

// A client reads the staging buffer in blocks of 127 segments while joints move and the bus has
// little room.
class DumpInMotion : public testing::Test {
 protected:
  DumpInMotion() {
    bench.stage(data);
    bench.configure(Mode::kInline);
    bench.upstream.take_sent();
    request({0xA4, 0x10, 0x20, 0, 127, 0, 0, 0});
  }
  void request(std::initializer_list<int> bytes) {
    bench.from_controller(make_frame(0x620, bytes));
  }

  // A millisecond in which the bus upstream takes `frames`.
  void cycle(int frames) {
    bench.now_us += 1000;
    const int position = 100 * ++cycles;
    bench.sync();
    bench.command_joints({position, position, position, position, position, position});
    bench.downstream.take_sent();
    for (const std::uint32_t id : {0x1C0U, 0x1C1U, 0x1C2U}) {
      if (id == 0x1C0U) ahead = std::max(ahead, bench.upstream.waiting());
      bench.from_drives(NodeBench::pair_frame(id, position, position));
    }
    CanFrame frame;
    segments = 0;
    for (int k = 0; k < frames && bench.upstream.take_one(frame); ++k) {
      if (frame.id == 0x580 + NodeBench::kNodeId) take(frame);
      bench.turn();  // the queue has moved: an interrupt
    }
  }

  void take(const CanFrame& frame) {
    if (frame.data[0] == 0xC6 && data_back.empty()) {
      request({0xA3, 0, 0, 0, 0, 0, 0, 0});
    } else if (block == 0 && (frame.data[0] & 0xE3) == 0xC1) {
      data_back.resize(data_back.size() - (frame.data[0] >> 2 & 7));
      is_done = load_le<std::uint16_t>(&frame.data[1]) == crc16(data_back);
    } else {
      ++segments;
      data_back.insert(data_back.end(), frame.data + 1, frame.data + 8);
      if (++block == 127 || (frame.data[0] & 0x80) != 0) {
        request({0xA2, std::exchange(block, 0), 127, 0, 0, 0, 0, 0});
      }
    }
  }

  const std::vector<std::uint8_t> data = pattern(2000);
  NodeBench bench;
  int cycles = 0;
  int block = 0;
  int segments = 0;       // of the last cycle
  std::size_t ahead = 0;  // largest number of frames ahead of a joint frame
  std::vector<std::uint8_t> data_back;
  bool is_done = false;
};

TEST_F(DumpInMotion, JointFrames_WaitForAtMostFourFrames_NoneIsRefused) {
  bench.upstream.set_room(32);
  CanFrame initiated;
  ASSERT_TRUE(bench.upstream.take_one(initiated));
  take(initiated);
  for (int k = 0; k < 20; ++k) bench.turn();  // at rest nothing else holds the segments back
  while (cycles < 100) cycle(3);              // room for the actual positions alone
  while (!is_done && cycles < 2000) cycle(4);
  EXPECT_TRUE(is_done);
  EXPECT_EQ(data_back, data);
  EXPECT_LE(ahead, 4U);
  EXPECT_GT(ahead, 0U);
  EXPECT_EQ(bench.upstream.counters().send_refused, 0U);
}

TEST_F(DumpInMotion, PortWithUnknownBacklog_SendsOneSegmentPerMillisecond) {
  cycle(100);
  cycle(100);
  while (!is_done && cycles < 2000) {
    cycle(100);
    EXPECT_LE(segments, 1);
  }
  EXPECT_EQ(data_back, data);
  EXPECT_LT(cycles, 2000 / 7 + 20);
}

// Silence of the client after the end of a transfer is no time-out.
TEST_F(SdoTest, TransfersThatAreDone_DoNotTimeOut) {
  const auto expect_quiet = [this] {
    answers();
    bench.run_for(SdoServer::kTimeOutUs + 10'000);
    EXPECT_TRUE(answers().empty());
  };
  bench.ask({0x21, 0x10, 0x20, 0, 9, 0, 0, 0});
  bench.ask({0x00, 1, 2, 3, 4, 5, 6, 7});
  bench.ask({0x10 | 5 << 1 | 1, 8, 9, 0, 0, 0, 0, 0});
  expect_quiet();
  const std::vector<std::uint8_t> data = pattern(20);
  send({0xC6, 0x10, 0x20, 0, 20, 0, 0, 0});
  send_segments(data, 0, 3, true);
  end_block(data, crc16(data));
  EXPECT_EQ(answers().back().data[0], 0xA1);
  expect_quiet();
  send({0xA4, 0x08, 0x10, 0, 127, 0, 0, 0});
  send({0xA3, 0, 0, 0, 0, 0, 0, 0});
  bench.run_for(1'000);
  send({0xA2, 3, 127, 0, 0, 0, 0, 0});
  EXPECT_EQ(answers().back().data[0] & 0xE3, 0xC1);
  send({0xA1, 0, 0, 0, 0, 0, 0, 0});
  expect_quiet();
}

TEST_F(SdoTest, BlockUploadWithoutCrc_EndsWithZero) {
  for (const int with_crc : {0, 4}) {
    send({0xA0 | with_crc, 0x08, 0x10, 0, 127, 0, 0, 0});
    send({0xA3, 0, 0, 0, 0, 0, 0, 0});
    bench.run_for(1'000);
    answers();
    send({0xA2, 3, 127, 0, 0, 0, 0, 0});
    EXPECT_EQ(load_le<std::uint16_t>(&answers().at(0).data[1]) != 0, with_crc != 0);
    send({0xA1, 0, 0, 0, 0, 0, 0, 0});
  }
}

TEST_F(SdoTest, ExpeditedDownloadWithoutSize_ToADomainHasFourBytes) {
  EXPECT_EQ(bench.ask({0x22, 0x10, 0x20, 0, 1, 2, 3, 4})[0], 0x60);
  EXPECT_EQ(bench.read(0x2013, 3), 4U);
}

}  // namespace
}  // namespace armtrue::canopen
