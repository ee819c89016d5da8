// Transfer of a table onto the device, and the reasons to refuse it.
#include "firmware/canopen/table/table_transfer.h"

#include <gtest/gtest.h>

#include "firmware/core/crypto/crc32.h"
#include "firmware/testing/node_bench.h"
#include "firmware/testing/test_table.h"

namespace armtrue::canopen {
namespace {

constexpr std::uint32_t kIncompatible = static_cast<std::uint32_t>(Abort::kIncompatibleParameter);

DeviceIdentity bound_to(const std::string& serial) {
  DeviceIdentity device;
  serial.copy(device.robot_serial.data(), device.robot_serial.size());
  return device;
}

enum Sub : std::uint8_t {
  kStaging = 1,
  kReason = 2,
  kBytesStaged = 3,
  kStagedChecksum = 4,
  kCapacity = 5,
  kFormat = 6,
  kSignature = 7,
  kSlotA = 8,
  kSequenceA = 9,
  kSlotB = 10,
  kSequenceB = 11,
  kActiveSlot = 12,
  kActiveChecksum = 13,
  kTrial = 14,
  kRefusedByte = 15,
  kSequence = 16,
  kStoreResult = 17
};

// `image` with another value in one joint's record.
template <typename T>
std::vector<std::uint8_t> with_joint(std::vector<std::uint8_t> image, std::size_t joint,
                                     std::size_t field, T value) {
  const std::size_t at = static_cast<std::size_t>(TableView(image).joint(joint) - image.data());
  store_le(&image[at + field], value);
  store_le(&image[image.size() - 4], crc32(std::span(image).first(image.size() - 4)));
  return image;
}

class TableTransferTest : public testing::Test {
 protected:
  std::uint32_t status(std::uint8_t sub) { return bench.read(0x2013, sub); }
  void expect_refused(const std::vector<std::uint8_t>& image, std::uint32_t reason) {
    ASSERT_EQ(bench.stage(image), 0U);
    const std::uint32_t refused = bench.read(0x2001, 6);
    EXPECT_EQ(bench.command(TableCommand::kVerify), kIncompatible);
    EXPECT_EQ(bench.read(0x2001, 6), refused + 1);
    EXPECT_EQ(status(kStaging), 4U);
    EXPECT_EQ(status(kReason), reason);
    EXPECT_EQ(bench.command(TableCommand::kCommit), kDeviceState);
    EXPECT_EQ(bench.read(0x1003, 1) & 0xFFFFU, 0xFF11U);
  }
  NodeBench bench{true, false, bound_to("R-7")};
};

TEST_F(TableTransferTest, ConfirmedTable_IsInForceAfterPowerOn) {
  const std::vector<std::uint8_t> image = TestTable{.sequence = 5, .serial = "R-7"}.image();
  ASSERT_EQ(bench.stage(image), 0U);
  EXPECT_EQ(status(kStaging), 2U);
  EXPECT_EQ(bench.command(TableCommand::kCommit), kDeviceState) << "verify first";
  ASSERT_EQ(bench.command(TableCommand::kVerify), 0U);
  ASSERT_EQ(bench.command(TableCommand::kCommit), 0U);
  EXPECT_EQ(status(kActiveSlot), 0xFFU);
  ASSERT_EQ(bench.command(TableCommand::kActivate), 0U);
  EXPECT_EQ(status(kTrial), 1U);
  EXPECT_EQ(status(kSequence), 5U);
  ASSERT_EQ(bench.command(TableCommand::kConfirm), 0U);
  bench.power_on();
  EXPECT_EQ(status(kSequence), 5U);
  EXPECT_EQ(status(kTrial), 0U);
}

TEST_F(TableTransferTest, Checksums_FollowTheStagedAndTheActiveTable) {
  const std::vector<std::uint8_t> one = TestTable{.sequence = 5, .serial = "R-7"}.image();
  const std::vector<std::uint8_t> two = TestTable{.sequence = 6, .serial = "R-7"}.image();
  const auto checksum = [](const std::vector<std::uint8_t>& image) {
    return crc32(std::span(image).first(image.size() - 4));
  };
  EXPECT_EQ(status(kStagedChecksum), 0U);
  EXPECT_EQ(status(kActiveChecksum), 0U);
  for (const std::size_t size : {3U, 4U, 5U, 8U, 21U}) {
    const std::vector<std::uint8_t> few(one.begin(),
                                        one.begin() + static_cast<std::ptrdiff_t>(size));
    ASSERT_EQ(bench.stage(few), 0U);
    EXPECT_EQ(status(kStagedChecksum), size < 4 ? 0U : checksum(few)) << size;
  }
  bench.install(one);
  EXPECT_EQ(status(kStagedChecksum), 0U);
  EXPECT_EQ(status(kActiveChecksum), checksum(one));
  ASSERT_EQ(bench.stage(two), 0U);
  EXPECT_EQ(status(kStagedChecksum), checksum(two));
  EXPECT_EQ(status(kActiveChecksum), checksum(one));
  ASSERT_EQ(bench.command(TableCommand::kVerify), 0U);
  ASSERT_EQ(bench.command(TableCommand::kCommit), 0U);
  ASSERT_EQ(bench.command(TableCommand::kActivate), 0U);
  EXPECT_EQ(status(kActiveChecksum), checksum(two));
  ASSERT_EQ(bench.command(TableCommand::kRevert), 0U);
  EXPECT_EQ(status(kActiveChecksum), checksum(one));
  ASSERT_EQ(bench.stage(two), 0U);
  ASSERT_EQ(bench.command(TableCommand::kDiscard), 0U);
  EXPECT_EQ(status(kStagedChecksum), 0U);
  bench.power_on();
  EXPECT_EQ(status(kActiveChecksum), checksum(one));
}

TEST_F(TableTransferTest, UnconfirmedTrial_EndsWithAReset) {
  bench.install(TestTable{.sequence = 5, .serial = "R-7"}.image());
  bench.put_on_trial(TestTable{.sequence = 6, .serial = "R-7"}.image());
  EXPECT_EQ(status(kSequence), 6U);
  bench.nmt(129);
  EXPECT_EQ(status(kSequence), 5U);
}

TEST_F(TableTransferTest, Revert_RestoresThePreviousTableAtOnce) {
  bench.install(TestTable{.sequence = 5, .serial = "R-7"}.image());
  bench.put_on_trial(TestTable{.sequence = 6, .serial = "R-7"}.image());
  ASSERT_EQ(bench.command(TableCommand::kRevert), 0U);
  EXPECT_EQ(status(kSequence), 5U);
  EXPECT_EQ(bench.command(TableCommand::kRevert), kDeviceState) << "nothing left to revert";
  bench.power_on();
  EXPECT_EQ(status(kSequence), 5U);
}

TEST_F(TableTransferTest, RevertedCommit_CanBeCommittedAgainFromTheBuffer) {
  for (const bool mark_fails : {false, true}) {
    bench.commit(TestTable{.serial = "R-7"}.image());
    bench.flash.protect(mark_fails);
    EXPECT_EQ(bench.command(TableCommand::kRevert) != 0, mark_fails);
    bench.flash.protect(false);
    EXPECT_EQ(status(kStaging), 3U) << "verified: no slot has it any more";
    ASSERT_EQ(bench.command(TableCommand::kVerify), 0U);
    ASSERT_EQ(bench.command(TableCommand::kCommit), 0U);
    ASSERT_EQ(bench.command(TableCommand::kActivate), 0U);
    EXPECT_EQ(status(kSequence), 1U);
    ASSERT_EQ(bench.command(TableCommand::kRevert), 0U);
  }
}

TEST_F(TableTransferTest, RevertOfACommit_DoesNotVerifyATableStagedSince) {
  bench.commit(TestTable{.serial = "R-7"}.image());
  ASSERT_EQ(bench.stage(TestTable{.sequence = 2, .serial = "R-7"}.image()), 0U);
  ASSERT_EQ(bench.command(TableCommand::kRevert), 0U);
  EXPECT_EQ(status(kStaging), 2U);
}

TEST_F(TableTransferTest, TheFirstTableRevertsToPassThrough) {
  bench.put_on_trial(TestTable{.serial = "R-7"}.image());
  ASSERT_NE(status(kActiveChecksum), 0U);
  ASSERT_EQ(bench.command(TableCommand::kRevert), 0U);
  EXPECT_EQ(status(kActiveChecksum), 0U);
  EXPECT_EQ(status(kSequence), 0U);
  EXPECT_EQ(status(kActiveSlot), 0xFFU);
  bench.install(TestTable{.sequence = 2, .serial = "R-7"}.image());
  EXPECT_EQ(status(kSequence), 2U);
}

TEST_F(TableTransferTest, AnotherRobotsTableIsRefused) {
  expect_refused(TestTable{.serial = "R-8"}.image(),
                 static_cast<std::uint32_t>(Refusal::kRobotSerial));
}

TEST_F(TableTransferTest, TableOfAnotherJointCount_IsRefused) {
  expect_refused(TestTable{.joints = 5, .serial = "R-7"}.image(),
                 static_cast<std::uint32_t>(Refusal::kJointCount));
}

TEST_F(TableTransferTest, ADamagedTableIsRefused) {
  std::vector<std::uint8_t> image = TestTable{.serial = "R-7"}.image();
  image[200] ^= 1;
  expect_refused(image, static_cast<std::uint32_t>(Refusal::kChecksum));
}

TEST_F(TableTransferTest, AnOlderExportIsRefusedAndTheSameOneIsNot) {
  const std::vector<std::uint8_t> image = TestTable{.sequence = 5, .serial = "R-7"}.image();
  bench.install(image);
  expect_refused(TestTable{.sequence = 4, .serial = "R-7"}.image(), 0x100);
  expect_refused(TestTable{.sequence = 5, .serial = "R-7", .amplitude = 99}.image(), 0x100);
  ASSERT_EQ(bench.stage(image), 0U);
  EXPECT_EQ(bench.command(TableCommand::kVerify), 0U);
}

TEST_F(TableTransferTest, ADeviceWithAKeyRefusesUnsignedTables) {
  DeviceIdentity device = bound_to("R-7");
  device.has_key = true;
  NodeBench keyed(true, false, device);
  ASSERT_EQ(keyed.stage(TestTable{.serial = "R-7"}.image()), 0U);
  EXPECT_EQ(keyed.command(TableCommand::kVerify), kIncompatible);
  EXPECT_EQ(keyed.read(0x2013, kReason), static_cast<std::uint32_t>(Refusal::kUnsigned));
}

TEST_F(TableTransferTest, WhileJointsAreCommanded_TableCommandsAreRefused) {
  const std::vector<std::uint8_t> image = TestTable{.serial = "R-7"}.image();
  ASSERT_EQ(bench.stage(image), 0U);
  bench.configure(Mode::kInline);
  bench.command_joints({});
  for (const TableCommand word :
       {TableCommand::kVerify, TableCommand::kCommit, TableCommand::kActivate,
        TableCommand::kConfirm, TableCommand::kRevert}) {
    EXPECT_EQ(bench.command(word), kDeviceState);
  }
  EXPECT_EQ(bench.stage(image), kDeviceState);
  EXPECT_GE(bench.read(0x2001, 6), 6U) << "all counted";
  bench.run_for(600'000);
  EXPECT_EQ(bench.command(TableCommand::kVerify), 0U) << "what was staged before is still there";
}

TEST_F(TableTransferTest, InterruptedTransfer_EmptiesTheBuffer_CanBeRepeated) {
  bench.ask({0x21, 0x10, 0x20, 0, 200, 0, 0, 0});
  bench.ask({0x00, 1, 2, 3, 4, 5, 6, 7});
  EXPECT_EQ(status(kStaging), 0U) << "this very read was the interruption";
  ASSERT_EQ(bench.stage(TestTable{.serial = "R-7"}.image()), 0U);
  EXPECT_EQ(bench.command(TableCommand::kVerify), 0U);
}

TEST_F(TableTransferTest, AFailingFlashIsReportedAndTheOldTableStays) {
  bench.install(TestTable{.sequence = 1, .serial = "R-7"}.image());
  ASSERT_EQ(bench.stage(TestTable{.sequence = 2, .serial = "R-7"}.image()), 0U);
  ASSERT_EQ(bench.command(TableCommand::kVerify), 0U);
  bench.flash.fail_at(3);
  EXPECT_EQ(bench.command(TableCommand::kCommit), static_cast<std::uint32_t>(Abort::kHardware));
  EXPECT_EQ(status(kSequence), 1U);
  EXPECT_EQ(status(kStaging), 3U) << "verified, not committed";
  EXPECT_EQ(bench.read(0x1003, 1) & 0xFFFFU, 0x5530U);
  EXPECT_NE(bench.read(0x1001, 0), 0U);
  EXPECT_EQ(bench.command(TableCommand::kCommit), 0U) << "and may be tried again";
  EXPECT_EQ(bench.read(0x1001, 0), 0U);
}

TEST_F(TableTransferTest, Status_FollowsATableFromStagingToConfirmation) {
  const auto state = [](storage::SlotState slot) { return static_cast<std::uint32_t>(slot); };
  const auto image = [](std::uint32_t sequence) {
    return TestTable{.sequence = sequence, .serial = "R-7"}.image();
  };
  EXPECT_EQ(status(kCapacity), kMaxImageLength);
  EXPECT_EQ(status(kFormat), format::kVersion);
  EXPECT_EQ(status(kSignature), 0U);
  EXPECT_EQ(status(kSlotA), state(storage::SlotState::kBlank));
  EXPECT_EQ(status(kSlotB), state(storage::SlotState::kBlank));
  ASSERT_EQ(bench.stage(image(5)), 0U);
  EXPECT_EQ(status(kBytesStaged), image(5).size());
  ASSERT_EQ(bench.command(TableCommand::kVerify), 0U);
  EXPECT_EQ(status(kStaging), 3U);
  ASSERT_EQ(bench.command(TableCommand::kCommit), 0U);
  EXPECT_EQ(status(kStaging), 5U);
  EXPECT_EQ(status(kSlotA), state(storage::SlotState::kPending));
  ASSERT_EQ(bench.command(TableCommand::kActivate), 0U);
  EXPECT_EQ(status(kSlotA), state(storage::SlotState::kTrial));
  EXPECT_EQ(status(kTrial), 1U);
  ASSERT_EQ(bench.command(TableCommand::kConfirm), 0U);
  EXPECT_EQ(status(kSlotA), state(storage::SlotState::kConfirmed));
  EXPECT_EQ(status(kTrial), 0U);
  EXPECT_EQ(status(kStoreResult), 0U);
  bench.install(image(6));
  EXPECT_EQ(status(kSlotB), state(storage::SlotState::kConfirmed));
  EXPECT_EQ(status(kActiveSlot), 1U);
  // The store numbers its commits itself; these are not the tables' sequence numbers.
  EXPECT_EQ(status(kSequenceA), 1U);
  EXPECT_EQ(status(kSequenceB), 2U);
  EXPECT_EQ(bench.command(TableCommand::kConfirm), kDeviceState) << "no trial";
  EXPECT_EQ(status(kStoreResult), static_cast<std::uint32_t>(storage::StoreResult::kNoTrial));
}

TEST_F(TableTransferTest, CommandsThatTheStoreRefuses_AreCounted) {
  const std::uint32_t refused = bench.read(0x2001, 6);
  for (const TableCommand word :
       {TableCommand::kActivate, TableCommand::kConfirm, TableCommand::kRevert}) {
    EXPECT_EQ(bench.command(word), kDeviceState);
  }
  EXPECT_EQ(bench.read(0x2001, 6), refused + 3);
}

TEST_F(TableTransferTest, ActivateWithNothingCommitted_KeepsTheStagedTable) {
  ASSERT_EQ(bench.stage(TestTable{.serial = "R-7"}.image()), 0U);
  const std::uint32_t checksum = status(kStagedChecksum);
  EXPECT_EQ(bench.command(TableCommand::kActivate), kDeviceState);
  EXPECT_EQ(status(kStaging), 2U) << "received, and no more than that";
  EXPECT_EQ(status(kStagedChecksum), checksum);
  EXPECT_EQ(status(kSequence), 0U) << "nothing is in force";
  EXPECT_EQ(bench.command(TableCommand::kCommit), kDeviceState) << "nobody has verified it";
  ASSERT_EQ(bench.command(TableCommand::kVerify), 0U);
  EXPECT_EQ(bench.command(TableCommand::kActivate), kDeviceState);
  EXPECT_EQ(status(kStaging), 3U) << "verified";
  ASSERT_EQ(bench.command(TableCommand::kCommit), 0U);
  ASSERT_EQ(bench.command(TableCommand::kActivate), 0U);
  EXPECT_EQ(status(kSequence), 1U);
}

TEST_F(TableTransferTest, ActivateThatFailsInFlash_EmptiesTheStagingBuffer) {
  bench.commit(TestTable{.serial = "R-7"}.image());
  ASSERT_EQ(bench.stage(TestTable{.sequence = 2, .serial = "R-7"}.image()), 0U);
  bench.flash.protect(true);
  EXPECT_EQ(bench.command(TableCommand::kActivate), static_cast<std::uint32_t>(Abort::kHardware));
  EXPECT_EQ(status(kStaging), 0U) << "the slot's table was read into that buffer";
}

TEST_F(TableTransferTest, AcceptedTable_EndsTheErrorOfARefusedOne) {
  const auto wrong = TestTable{.serial = "R-8"}.image();
  expect_refused(wrong, static_cast<std::uint32_t>(Refusal::kRobotSerial));
  expect_refused(wrong, static_cast<std::uint32_t>(Refusal::kRobotSerial));
  EXPECT_EQ(bench.read(0x1003, 0), 2U) << "each refused image is its own event";
  EXPECT_NE(bench.read(0x1001, 0), 0U);
  ASSERT_EQ(bench.stage(TestTable{.serial = "R-7"}.image()), 0U);
  EXPECT_EQ(status(kReason), 0U);
  ASSERT_EQ(bench.command(TableCommand::kVerify), 0U);
  EXPECT_EQ(bench.read(0x1001, 0), 0U);
}

TEST_F(TableTransferTest, RefusedByte_IsReportedUntilTheTableIsDiscarded) {
  const auto image = TestTable{.serial = "R-7"}.image();
  const std::size_t field = format::joint::kMagnitudeAt;
  const auto at = static_cast<std::uint32_t>(TableView(image).joint(2) - image.data() + field);
  expect_refused(
      with_joint(image, 2, field, std::int32_t{-1}),
      static_cast<std::uint32_t>(
          validate(with_joint(image, 2, field, std::int32_t{-1}), bound_to("R-7")).refusal));
  EXPECT_EQ(status(kRefusedByte), at);
  ASSERT_EQ(bench.command(TableCommand::kDiscard), 0U);
  EXPECT_EQ(status(kRefusedByte), 0U);
  EXPECT_EQ(status(kReason), 0U);
}

TEST_F(TableTransferTest, TooWideLimitOfOneJoint_IsRefused) {
  const auto image = TestTable{.serial = "R-7"}.image();
  for (std::size_t joint = 0; joint < 6; ++joint) {
    SCOPED_TRACE(joint);
    expect_refused(
        with_joint(image, joint, format::joint::kMagnitudeAt, std::int32_t{kMaxDeltaRevolute + 1}),
        0x101);
    EXPECT_EQ(status(kRefusedByte), 0U) << "more than one field may be meant";
    expect_refused(with_joint(image, joint, format::joint::kRateAt, kMaxRateRevolute + 1), 0x101);
  }
}

TEST_F(TableTransferTest, RevertWithFailingFlash_StillEndsTheTrial) {
  bench.install(TestTable{.sequence = 5, .serial = "R-7"}.image());
  bench.put_on_trial(TestTable{.sequence = 6, .serial = "R-7"}.image());
  bench.flash.protect(true);
  EXPECT_EQ(bench.command(TableCommand::kRevert), static_cast<std::uint32_t>(Abort::kHardware));
  EXPECT_EQ(status(kSequence), 5U);
  EXPECT_EQ(status(kTrial), 0U);
}

TEST_F(TableTransferTest, NonIntegerResolution_IsReportedAsARatio) {
  // 2^20 + 2^-10 increments a turn.
  auto image = with_joint(TestTable{.serial = "R-7"}.image(), 4, format::joint::kIncrementPerUnitAt,
                          std::int32_t{(1 << 30) + 1});
  image = with_joint(image, 4, format::joint::kUnitPerIncrementAt, std::int32_t{(1 << 30) - 1});
  bench.install(image);
  EXPECT_EQ(bench.read(0x608F + 4 * 0x800, 1), 1'048'576'001U);
  EXPECT_EQ(bench.read(0x608F + 4 * 0x800, 2), 1000U);
  EXPECT_EQ(bench.read(0x608F, 1), 1'048'576U);
  EXPECT_EQ(bench.read(0x608F, 2), 1U);
}

TEST_F(TableTransferTest, IntegerResolution_IsReportedInIncrements) {
  for (const int finer : {0, 4, 9, 10}) {
    NodeBench other(true, false, bound_to("R-7"));
    other.install(TestTable{.serial = "R-7", .finer = finer}.image());
    EXPECT_EQ(other.read(0x608F, 1), 1U << (20 + finer)) << finer;
    EXPECT_EQ(other.read(0x608F, 2), 1U);
  }
}

TEST_F(TableTransferTest, ResolutionOfATable_IsTakenWhenItIsConfirmed) {
  NodeBench blank(true, false, bound_to("R-7"));
  blank.put_on_trial(TestTable{.serial = "R-7", .finer = 4}.image());
  EXPECT_EQ(blank.read(0x608F, 1), 0U);
  ASSERT_EQ(blank.command(TableCommand::kRevert), 0U);
  EXPECT_EQ(blank.read(0x608F, 1), 0U);
  EXPECT_EQ(blank.read(0x608F, 2), 1U);
  blank.put_on_trial(TestTable{.serial = "R-7"}.image());
  ASSERT_EQ(blank.command(TableCommand::kConfirm), 0U);
  EXPECT_EQ(blank.read(0x608F, 1), 1U << 20);
  blank.put_on_trial(TestTable{.sequence = 9, .serial = "R-7"}.image());
  ASSERT_EQ(blank.command(TableCommand::kRevert), 0U);
  EXPECT_EQ(blank.read(0x608F, 1), 1U << 20) << "that of the confirmed table";
}

// A power cut ends the trial. Its resolution must not stay behind in the saved parameters.
TEST_F(TableTransferTest, SaveDuringATrial_DoesNotKeepItsResolution) {
  bench.put_on_trial(TestTable{.serial = "R-7", .finer = 4}.image());
  ASSERT_EQ(bench.write(0x1010, 1, kSave, 4), 0U);
  bench.power_on();
  ASSERT_EQ(status(kActiveSlot), 0xFFU) << "the trial is over";
  EXPECT_EQ(bench.read(0x608F, 1), 0U);
  bench.install(TestTable{.sequence = 2, .serial = "R-7"}.image());
  EXPECT_EQ(bench.read(0x608F, 1), 1U << 20);
}

TEST_F(TableTransferTest, ConfirmWhileDisabled_TakesTheResolution) {
  ASSERT_EQ(bench.write(0x2000, 2, 0, 1), 0U);
  bench.install(TestTable{.serial = "R-7"}.image());
  EXPECT_EQ(bench.read(0x608F, 1), 1U << 20);
  ASSERT_EQ(bench.stage(TestTable{.sequence = 2, .serial = "R-7", .finer = 1}.image()), 0U);
  EXPECT_NE(bench.command(TableCommand::kVerify), 0U);
  EXPECT_EQ(status(kReason), static_cast<std::uint32_t>(Refusal::kResolution));
}

TEST_F(TableTransferTest, ConfirmOfAnotherResolutionWhileDisabled_TakesNone) {
  ASSERT_EQ(bench.write(0x2000, 2, 0, 1), 0U);
  bench.commit(TestTable{.serial = "R-7"}.image());
  ASSERT_EQ(bench.write(0x608F, 1, 1U << 24, 4), 0U) << "other drives";
  ASSERT_EQ(bench.command(TableCommand::kActivate), 0U);
  ASSERT_EQ(bench.command(TableCommand::kConfirm), 0U);
  EXPECT_EQ(bench.read(0x608F + 0x800, 1), 0U);
}

// CiA 301: it resets objects 0x1000 to 0x1FFF alone.
TEST_F(TableTransferTest, ResetCommunication_LeavesTheTrialRunning) {
  bench.install(TestTable{.sequence = 5, .serial = "R-7"}.image());
  bench.put_on_trial(TestTable{.sequence = 6, .serial = "R-7"}.image());
  bench.nmt(130);
  bench.run_for(10'000);
  EXPECT_EQ(status(kSequence), 6U);
  EXPECT_EQ(status(kTrial), 1U);
}

TEST_F(TableTransferTest, TableOfOtherResolution_DoesNotBlockTheBuffer) {
  const auto image = TestTable{.serial = "R-7"}.image();
  bench.commit(image);
  ASSERT_EQ(bench.write(0x608F, 1, 1U << 24, 4), 0U) << "other drives";
  ASSERT_EQ(bench.command(TableCommand::kActivate), 0U);
  EXPECT_EQ(status(kReason), static_cast<std::uint32_t>(Refusal::kResolution));
  ASSERT_EQ(bench.command(TableCommand::kRevert), 0U);
  EXPECT_EQ(bench.stage(image), 0U);
}

TEST_F(TableTransferTest, UnknownCommandWordsAreRefused) {
  EXPECT_EQ(bench.write(0x2012, 0, 0, 4), static_cast<std::uint32_t>(Abort::kValueRange));
}

}  // namespace
}  // namespace armtrue::canopen
