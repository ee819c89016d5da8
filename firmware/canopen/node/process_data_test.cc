// PDOs that carry no targets: inputs from either bus, taken at once or with SYNC.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <tuple>

#include "firmware/testing/node_bench.h"

namespace armtrue::canopen {
namespace {

constexpr std::uint32_t kPayload = 0x20210020;

class InputTest : public testing::Test {
 protected:
  explicit InputTest(bool fd = false) : bench(true, fd) {}
  // Maps `word` into RPDO 16 + `number` on 0x190 + `number`.
  void map(std::uint16_t number, std::uint32_t word, std::uint32_t transmission) {
    const auto communication = static_cast<std::uint16_t>(0x140F + number);
    const auto mapping = static_cast<std::uint16_t>(0x160F + number);
    ASSERT_EQ(bench.write(communication, 1, 0x80000190U + number, 4), 0U);
    ASSERT_EQ(bench.write(communication, 2, transmission, 1), 0U);
    ASSERT_EQ(bench.write(mapping, 0, 0, 1), 0U);
    ASSERT_EQ(bench.write(mapping, 1, word, 4), 0U);
    ASSERT_EQ(bench.write(mapping, 0, 1, 1), 0U);
    ASSERT_EQ(bench.write(communication, 1, 0x190U + number, 4), 0U);
  }
  void sync() { bench.sync(); }
  std::int16_t temperature(std::uint8_t sensor) {
    return static_cast<std::int16_t>(bench.read(0x2020, sensor));
  }
  std::uint32_t newest_error() { return bench.read(0x1003, 1); }

  NodeBench bench;
};

TEST_F(InputTest, AnInputFromTheDrivesSide_IsTakenAndPassedOn) {
  map(0, 0x20200210, 255);
  bench.start_nodes();
  bench.upstream.take_sent();
  bench.from_drives(make_frame(0x190, {0x34, 0x12}));
  ASSERT_EQ(bench.upstream.take_sent().size(), 1U);
  EXPECT_EQ(temperature(2), 0x1234);
}

TEST_F(InputTest, AnInputThatWaitsForSync_IsTakenOnce) {
  map(0, kPayload, 0);
  bench.start_nodes();
  bench.from_controller(make_frame(0x190, {1, 0, 0, 0}));
  EXPECT_EQ(bench.read(0x2021, 0), 0U);
  sync();
  EXPECT_EQ(bench.read(0x2021, 0), 1U);
  ASSERT_EQ(bench.write(0x2021, 0, 2, 4), 0U);
  sync();
  EXPECT_EQ(bench.read(0x2021, 0), 2U) << "the frame before has had its SYNC";
}

TEST_F(InputTest, AnInputThatWaitsForSync_IsDroppedByAReset) {
  map(0, kPayload, 1);
  ASSERT_EQ(bench.write(0x1010, 1, kSave, 4), 0U);
  bench.start_nodes();
  bench.from_controller(make_frame(0x190, {1, 0, 0, 0}));
  bench.nmt(130);
  bench.run_for(1000);
  bench.start_nodes();
  sync();
  EXPECT_EQ(bench.read(0x2021, 0), 0U);
}

TEST_F(InputTest, TwoInputsBeforeSync_TheNewestIsTaken) {
  map(0, kPayload, 240);
  bench.start_nodes();
  bench.from_controller(make_frame(0x190, {1, 0, 0, 0}));
  bench.from_controller(make_frame(0x190, {3, 0, 0, 0}));
  EXPECT_EQ(bench.read(0x2021, 0), 0U);
  sync();
  EXPECT_EQ(bench.read(0x2021, 0), 3U);
}

TEST_F(InputTest, FourInputs_WaitForTheirSync) {
  for (std::uint16_t k = 0; k < 4; ++k) map(k, 0x20200010U + 0x100U * (k + 1U), 1);
  bench.start_nodes();
  for (int k = 0; k < 4; ++k) {
    bench.from_controller(make_frame(0x190U + static_cast<std::uint32_t>(k), {10 + k, 0}));
  }
  for (std::uint8_t sensor = 1; sensor <= 4; ++sensor) EXPECT_EQ(temperature(sensor), 0);
  sync();
  for (std::uint8_t sensor = 1; sensor <= 4; ++sensor) EXPECT_EQ(temperature(sensor), 9 + sensor);
}

TEST_F(InputTest, InputAtItsBound_IsTaken_BeyondItIsReported) {
  map(0, kPayload, 255);
  bench.start_nodes();
  bench.from_controller(make_frame(0x190, {0x80, 0x84, 0x1E, 0}));
  EXPECT_EQ(bench.read(0x2021, 0), 2'000'000U);
  bench.from_controller(make_frame(0x190, {0x81, 0x84, 0x1E, 0}));
  EXPECT_EQ(bench.read(0x2021, 0), 2'000'000U);
  EXPECT_EQ(newest_error(), 0x2021FF18U) << "which object";
  EXPECT_NE(bench.read(0x1001, 0), 0U);
  bench.from_controller(make_frame(0x190, {0, 0, 0, 0}));
  EXPECT_EQ(bench.read(0x2021, 0), 0U);
  EXPECT_EQ(bench.read(0x1001, 0), 0U) << "over with one that is within them";
}

// A frame is served by one PDO alone. A second one with its identifier would never be received.
TEST_F(InputTest, CobIdOfAValidPdo_CannotBeUsedAgain) {
  const auto refused = static_cast<std::uint32_t>(Abort::kIncompatibleParameter);
  map(0, kPayload, 255);
  ASSERT_EQ(bench.write(0x1400, 1, 0x220, 4), 0U);
  EXPECT_EQ(bench.write(0x1401, 1, 0x220, 4), refused);
  EXPECT_EQ(bench.write(0x1401, 1, 0x190, 4), refused) << "a lower number";
  EXPECT_EQ(bench.write(0x1400, 1, 0x220, 4), 0U) << "its own";
  EXPECT_EQ(bench.write(0x1800, 1, 0x40000190, 4), refused) << "of an RPDO";
  ASSERT_EQ(bench.write(0x1800, 1, 0x400001A0, 4), 0U);
  EXPECT_EQ(bench.write(0x1801, 1, 0x400001A0, 4), refused);
  EXPECT_EQ(bench.write(0x1401, 1, 0x1A0, 4), refused) << "of a TPDO";
  EXPECT_EQ(bench.write(0x1401, 1, 0x80000220, 4), 0U) << "it stays invalid";
  ASSERT_EQ(bench.write(0x1400, 1, 0x80000220, 4), 0U);
  EXPECT_EQ(bench.write(0x1401, 1, 0x220, 4), 0U) << "free again";
}

TEST_F(InputTest, CobIdOfSync_IsRefusedForAPdo) {
  const auto refused = static_cast<std::uint32_t>(Abort::kIncompatibleParameter);
  EXPECT_EQ(bench.write(0x1400, 1, 0x80, 4), refused);
  EXPECT_EQ(bench.write(0x1800, 1, 0x40000080, 4), refused);
  ASSERT_EQ(bench.write(0x1400, 1, 0x220, 4), 0U);
  EXPECT_EQ(bench.write(0x1005, 0, 0x220, 4), refused);
  ASSERT_EQ(bench.write(0x1005, 0, 0x320, 4), 0U);
  EXPECT_EQ(bench.write(0x1401, 1, 0x320, 4), refused);
  EXPECT_EQ(bench.write(0x1401, 1, 0x80, 4), 0U);
}

// Temperature of sensor 1 and the payload, in the frame of joints 1 and 2's targets.
class InputBesideTargetsTest : public InputTest {
 protected:
  InputBesideTargetsTest() : InputTest(true) {
    bench.configure(Mode::kInline);
    EXPECT_EQ(bench.write(0x2000, 1, 0, 1), 0U);
    EXPECT_EQ(bench.write(0x1400, 1, 0x80000220, 4), 0U);
    EXPECT_EQ(bench.write(0x1600, 0, 0, 1), 0U);
    const std::uint32_t mapped[] = {0x607A0020, 0x687A0020, 0x20200110, kPayload};
    for (std::uint8_t k = 0; k < 4; ++k) {
      EXPECT_EQ(bench.write(0x1600, static_cast<std::uint8_t>(k + 1), mapped[k], 4), 0U);
    }
    EXPECT_EQ(bench.write(0x1600, 0, 4, 1), 0U);
    EXPECT_EQ(bench.write(0x1400, 1, 0x220, 4), 0U);
    EXPECT_EQ(bench.write(0x2000, 6, 200, 4), 0U);
    EXPECT_EQ(bench.write(0x2000, 1, 1, 1), 0U);
  }
  void cycles(int count, std::int16_t centidegrees, std::uint32_t payload_g) {
    for (int k = 0; k < count; ++k) {
      bench.now_us += 1000;
      sync();
      std::array<CanFrame, 3> frames = NodeBench::targets({});
      frames[0].flags |= kFrameFd;
      frames[0].len = 16;
      store_le(&frames[0].data[8], centidegrees);
      store_le(&frames[0].data[10], payload_g);
      for (const CanFrame& frame : frames) bench.from_controller(frame);
    }
  }
};

TEST_F(InputBesideTargetsTest, TemperatureWithTargets_IsUpdatedByEverySet) {
  cycles(600, 2500, 3000);
  EXPECT_EQ(temperature(1), 2500);
  EXPECT_EQ(bench.read(0x2021, 0), 3000U);
  EXPECT_EQ(bench.read(0x1003, 0), 0U) << "never silent";
  bench.run_for(300'000);
  EXPECT_EQ(newest_error(), 0x0001FF12U) << "then it is";
}

TEST_F(InputBesideTargetsTest, PayloadBeyondItsBound_IsRefused_TargetsAreTaken) {
  cycles(10, 2500, 3000);
  bench.downstream.take_sent();
  cycles(10, 2600, 0xFFFFFFFF);
  EXPECT_EQ(bench.read(0x2021, 0), 3000U);
  EXPECT_EQ(temperature(1), 2600);
  EXPECT_EQ(newest_error(), 0x2021FF18U);
  EXPECT_EQ(bench.downstream.take_sent().size(), 40U) << "SYNC and three frames a cycle";
  cycles(1, 2600, 4000);
  EXPECT_EQ(bench.read(0x2021, 0), 4000U);
  EXPECT_EQ(bench.read(0x1001, 0), 0U);
}

TEST_F(InputTest, InputBesideActualPosition_HasBoundsAndTimeOut) {
  bench.configure(Mode::kInline);
  ASSERT_EQ(bench.write(0x2000, 1, 0, 1), 0U);
  for (const auto& [rpdo, word, size] :
       {std::tuple{0, 0x20200110U, 6}, std::tuple{1, kPayload, 8}}) {
    const auto communication = static_cast<std::uint16_t>(0x1408 + rpdo);
    const auto mapping = static_cast<std::uint16_t>(0x1608 + rpdo);
    const std::uint32_t id = 0x1C0U + static_cast<std::uint32_t>(rpdo);
    ASSERT_EQ(bench.write(communication, 1, 0x80000000U + id, 4), 0U);
    ASSERT_EQ(bench.write(mapping, 0, 0, 1), 0U);
    ASSERT_EQ(bench.write(mapping, 1, 0x60640020U + 0x08000000U * static_cast<unsigned>(rpdo), 4),
              0U);
    ASSERT_EQ(bench.write(mapping, 2, word, 4), 0U);
    ASSERT_EQ(bench.write(mapping, 0, 2, 1), 0U);
    ASSERT_EQ(bench.write(communication, 1, id, 4), 0U);
  }
  ASSERT_EQ(bench.write(0x2000, 6, 200, 4), 0U);
  ASSERT_EQ(bench.write(0x2000, 1, 1, 1), 0U);
  for (int k = 0; k < 600; ++k) {
    bench.now_us += 1000;
    bench.from_drives(make_frame(0x1C0, {0, 0, 0, 0, 0x10, 0x0E}));
  }
  EXPECT_EQ(temperature(1), 3600);
  EXPECT_EQ(bench.read(0x1003, 0), 0U);
  bench.from_drives(make_frame(0x1C1, {0, 0, 0, 0, 0x81, 0x84, 0x1E, 0}));
  EXPECT_EQ(bench.read(0x2021, 0), 0U);
  EXPECT_EQ(newest_error(), 0x2021FF18U);
  bench.from_drives(make_frame(0x1C0, {0, 0, 0, 0, 0x10, 0x0E}));
  EXPECT_NE(bench.read(0x1001, 0), 0U) << "a value without bounds says nothing of one with";
  bench.run_for(300'000);
  EXPECT_EQ(newest_error(), 0x0001FF12U);
}

// Values that gateways send for a sensor that is broken or missing.
TEST_F(InputTest, ImpossibleTemperature_CountsAsMissing) {
  for (const std::uint32_t mark : {0x8000U, 0x7FFFU, 0x954CU}) {
    ASSERT_EQ(bench.write(0x2000, 6, 1000, 4), 0U);
    ASSERT_EQ(bench.write(0x2020, 3, 2500, 2), 0U);
    bench.run_for(900'000);
    ASSERT_EQ(bench.write(0x2020, 3, mark, 2), 0U);
    bench.run_for(101'000);
    EXPECT_EQ(newest_error(), 0x0003FF12U) << mark;
    ASSERT_EQ(bench.write(0x2020, 3, 0x954D, 2), 0U) << "absolute zero can be";
    EXPECT_EQ(bench.read(0x1001, 0), 0U) << mark;
  }
}

TEST_F(InputTest, SilentSensor_IsReportedAlone) {
  map(0, 0x20200310, 255);
  ASSERT_EQ(bench.write(0x2000, 6, 1000, 4), 0U);
  bench.start_nodes();
  bench.from_controller(make_frame(0x190, {1, 0}));
  bench.run_for(1'000'000);
  EXPECT_EQ(bench.read(0x1003, 0), 0U) << "a second is not over before that";
  bench.run_for(1);
  EXPECT_EQ(newest_error(), 0x0003FF12U);
  EXPECT_EQ(bench.read(0x1003, 0), 1U);
}

TEST_F(InputTest, TpdoForEveryThirdSync_LeavesWithTheThird) {
  ASSERT_EQ(bench.write(0x1808, 2, 3, 1), 0U);
  ASSERT_EQ(bench.write(0x1808, 1, 0x400001A8, 4), 0U);
  bench.start_nodes();
  bench.upstream.take_sent();
  for (int number = 1; number <= 9; ++number) {
    sync();
    EXPECT_EQ(bench.upstream.take_sent().size(), number % 3 == 0 ? 1U : 0U) << number;
  }
}

TEST_F(InputTest, UnchangedTpdo_IsSentOnceAtEveryStart) {
  ASSERT_EQ(bench.write(0x1800, 1, 0xC00001A0, 4), 0U);
  ASSERT_EQ(bench.write(0x1A00, 0, 0, 1), 0U);
  ASSERT_EQ(bench.write(0x1A00, 1, 0x20010108, 4), 0U);
  ASSERT_EQ(bench.write(0x1A00, 0, 1, 1), 0U);
  ASSERT_EQ(bench.write(0x1800, 1, 0x400001A0, 4), 0U);
  const auto sent = [this] {
    bench.run_for(10'000);
    const auto frames = bench.upstream.take_sent();
    return std::ranges::count(frames, 0x1A0U, &CanFrame::id);
  };
  EXPECT_EQ(sent(), 0) << "not operational yet";
  for (const int command : {128, 2, 130}) {
    bench.start_nodes();
    EXPECT_EQ(sent(), 1) << command;
    EXPECT_EQ(sent(), 0) << command;
    if (command != 130) bench.nmt(command);
  }
}

// Bytes beyond a frame's length are ignored: a SYNC of length 0 has no counter.
TEST_F(InputTest, SyncWithoutCounter_StartsTpdosWithSyncStartValue) {
  ASSERT_EQ(bench.write(0x1808, 6, 4, 1), 0U);
  ASSERT_EQ(bench.write(0x1808, 2, 1, 1), 0U);
  ASSERT_EQ(bench.write(0x1808, 1, 0x400001A8, 4), 0U);
  bench.start_nodes();
  bench.upstream.take_sent();
  CanFrame frame = make_frame(0x80, {});
  frame.data[0] = 7;
  bench.from_controller(frame);
  const std::vector<CanFrame> sent = bench.upstream.take_sent();
  ASSERT_EQ(sent.size(), 1U);
  EXPECT_EQ(sent[0].id, 0x1A8U);
}

TEST_F(InputTest, SyncOfTheRightLength_EndsTheLengthError) {
  bench.start_nodes();
  bench.from_controller(make_frame(0x80, {1}));
  EXPECT_EQ(newest_error(), 0x00018240U) << "the length that it had";
  EXPECT_NE(bench.read(0x1001, 0), 0U);
  sync();
  EXPECT_EQ(bench.read(0x1001, 0), 0U);
}

}  // namespace
}  // namespace armtrue::canopen
