// Limits that even a signed table must keep: scales whose corrections exceed the maxima, rates too
// low to end a fade, couplings beyond the solver's range.
#include <gtest/gtest.h>

#include <limits>

#include "firmware/core/compensator.h"
#include "firmware/core/table/table.h"
#include "firmware/core/table/table_cost.h"
#include "firmware/core/table/test_image.h"

namespace armtrue {
namespace {

using tests::append;
using tests::Bytes;
using tests::put;
using tests::TestImage;

// One field of joint `joint` set to `value`.
template <typename Integer>
Bytes with_joint_field(std::size_t joint, std::size_t field, Integer value) {
  TestImage made(3);
  put(made.section(format::Section::kJoints), joint * format::joint::kLength + field, value);
  return made.image();
}

TestImage with_scale(std::int32_t u, std::uint8_t s, std::int32_t v, std::uint8_t t) {
  TestImage made(3);
  Bytes& joints = made.section(format::Section::kJoints);
  for (std::size_t k = 0; k < 3; ++k) {
    const std::size_t at = k * format::joint::kLength;
    put(joints, at + format::joint::kUnitPerIncrementAt, u);
    put(joints, at + format::joint::kIncrementPerUnitAt, v);
    joints[at + format::joint::kUnitShiftAt] = s;
    joints[at + format::joint::kIncrementShiftAt] = t;
  }
  return made;
}

Refusal refusal_of(const Bytes& image) { return validate(image, {}).refusal; }

TEST(TableScaleTest, Scale_LargestMantissa_IsRefused) {
  // The table of the issue: only the scale back to increments is changed, so a correction of 0.05
  // turn becomes a step of 2^31 increments, which no limit of the table prevents.
  const Bytes image = with_joint_field(0, format::joint::kIncrementPerUnitAt,
                                       std::numeric_limits<std::int32_t>::max());
  const Validation validation = validate(image, {});
  EXPECT_EQ(validation.refusal, Refusal::kScale);
  EXPECT_EQ(validation.field - (format::header::kLength + 3 * format::kDirectoryEntryLength),
            format::joint::kIncrementPerUnitAt);
}

TEST(TableScaleTest, Scale_InconsistentShiftOrSign_IsRefused) {
  EXPECT_EQ(refusal_of(with_joint_field(1, format::joint::kIncrementShiftAt, std::uint8_t{37})),
            Refusal::kScale);
  EXPECT_EQ(refusal_of(with_joint_field(1, format::joint::kIncrementShiftAt, std::uint8_t{39})),
            Refusal::kScale);
  EXPECT_EQ(refusal_of(with_joint_field(2, format::joint::kUnitPerIncrementAt, -(1 << 30))),
            Refusal::kScale);
  EXPECT_EQ(refusal_of(with_scale(-(1 << 30), 22, -(1 << 30), 38).image()), Refusal::kNone);
}

TEST(TableScaleTest, Scale_RoundedMantissas_AreAccepted) {
  // 3 000 000 increments a turn, mantissas of 30 bits as the exporter rounds them.
  const std::int32_t u = 750599938;  // 2^32 / 3e6 · 2^19
  const std::int32_t v = 768000000;  // 3e6 / 2^32 · 2^40
  EXPECT_EQ(refusal_of(with_scale(u, 19, v, 40).image()), Refusal::kNone);
  EXPECT_EQ(refusal_of(with_scale(u + 10, 19, v, 40).image()), Refusal::kNone);
  EXPECT_EQ(refusal_of(with_scale(u + 20, 19, v, 40).image()), Refusal::kScale);
  EXPECT_EQ(refusal_of(with_scale(u, 19, v - 20, 40).image()), Refusal::kScale);
}

TEST(TableScaleTest, Scale_CoarserThan16OrFinerThan2To31_IsRefused) {
  EXPECT_EQ(refusal_of(with_scale(1 << 30, 2, 1 << 30, 58).image()), Refusal::kNone);   // 2^4
  EXPECT_EQ(refusal_of(with_scale(1 << 30, 1, 1 << 30, 59).image()), Refusal::kScale);  // 2^3
  EXPECT_EQ(refusal_of(with_scale(1 << 30, 29, 1 << 30, 31).image()), Refusal::kNone);  // 2^31
  EXPECT_EQ(refusal_of(with_scale(1 << 30, 30, 1 << 30, 30).image()), Refusal::kScale);
}

TEST(TableScaleTest, ShiftOfOne_IsAccepted_ShiftOfZero_IsRefused) {
  EXPECT_EQ(refusal_of(with_scale(2048, 1, 1 << 20, 30).image()), Refusal::kNone);
  EXPECT_EQ(refusal_of(with_scale(1024, 0, 1 << 20, 30).image()), Refusal::kValueRange);
  EXPECT_EQ(refusal_of(with_scale(1 << 20, 19, 1, 1).image()), Refusal::kNone);
  EXPECT_EQ(refusal_of(with_scale(1 << 20, 20, 1, 0).image()), Refusal::kValueRange);
}

TEST(TableRateTest, RateBelowTheMinimum_IsRefused) {
  for (const std::int32_t rate : {0, 1, 999, 1000, kMinRate - 1}) {
    const Validation validation =
        validate(with_joint_field(1, format::joint::kRateAt, rate), DeviceIdentity{});
    EXPECT_EQ(validation.refusal, Refusal::kValueRange) << rate;
    EXPECT_EQ(validation.field - (format::header::kLength + 3 * format::kDirectoryEntryLength),
              format::joint::kLength + format::joint::kRateAt);
  }
  EXPECT_EQ(refusal_of(with_joint_field(1, format::joint::kRateAt, kMinRate)), Refusal::kNone);
}

TEST(TableRateTest, LowestRate_FadeEnds) {
  TestImage made(3);
  made.add_constant(0, -1e-5);
  put(made.section(format::Section::kJoints), format::joint::kRateAt, kMinRate);
  const Bytes image = made.image();
  // The shortest cycle: a millisecond holds sixteen of them.
  Compensator compensator({.joint_count = 3, .cycle_us = 62});
  ASSERT_TRUE(compensator.load(image, {}).accepted());
  ASSERT_TRUE(compensator.activate());
  CycleOutput output;
  for (int i = 0; i < 20000; ++i) output = compensator.cycle({});
  EXPECT_GT(output.delta[0], 0);
  compensator.disable();
  int cycles = 0;
  while (output.state != CompensatorState::kPassThrough && cycles < 100000) {
    output = compensator.cycle({});
    ++cycles;
  }
  EXPECT_LT(cycles, 25000);
  EXPECT_EQ(output.delta[0], 0);
}

TestImage with_coupling(const std::vector<std::array<std::int32_t, 3>>& entries) {
  TestImage made(3);
  for (const auto& [row, column, ratio] : entries) {
    Bytes record = {static_cast<std::uint8_t>(row), static_cast<std::uint8_t>(column), 0, 0};
    append(record, ratio);
    made.add(format::Section::kCoupling, record);
  }
  return made;
}

constexpr std::int32_t kMostNegative = std::numeric_limits<std::int32_t>::min();  // -8
constexpr std::int32_t kOne = std::int32_t{1} << format::coupling::kRatioFraction;

TEST(TableCouplingTest, Ratios_BeyondTheSolversRange_AreRefused) {
  EXPECT_EQ(refusal_of(with_coupling({{2, 1, -kOne}}).image()), Refusal::kNone);
  EXPECT_EQ(refusal_of(with_coupling({{2, 1, kMostNegative}}).image()), Refusal::kNone);
  EXPECT_EQ(refusal_of(with_coupling({{2, 1, kMostNegative}, {1, 0, 7 * kOne}}).image()),
            Refusal::kNone);
  EXPECT_EQ(refusal_of(with_coupling({{2, 1, kMostNegative}, {0, 1, 1}}).image()),
            Refusal::kValueRange);
  EXPECT_EQ(refusal_of(with_coupling({{0, 1, -1}, {2, 1, kMostNegative}}).image()),
            Refusal::kValueRange);
}

TEST(TableCouplingTest, DuplicateEntry_IsRefused) {
  EXPECT_EQ(refusal_of(with_coupling({{2, 1, kOne}, {2, 1, kOne}}).image()),
            Refusal::kBadReference);
  EXPECT_EQ(refusal_of(with_coupling({{2, 1, kOne}, {1, 2, kOne}}).image()), Refusal::kNone);
  EXPECT_EQ(refusal_of(with_coupling({{2, 1, kOne}, {2, 0, kOne}}).image()), Refusal::kNone);
}

TEST(TableCouplingTest, EntriesOfEightJoints_AreNotTakenForDuplicates) {
  TestImage made(8);
  for (const std::array<std::uint8_t, 2> place : {std::array<std::uint8_t, 2>{0, 5}, {7, 6}}) {
    Bytes record = {place[0], place[1], 0, 0};
    append(record, kOne);
    made.add(format::Section::kCoupling, record);
  }
  EXPECT_EQ(refusal_of(made.image()), Refusal::kNone);
}

TEST(TableCouplingTest, PrismaticJoint_OnEitherSide_IsRefused) {
  for (const std::size_t slides : {1, 2}) {
    TestImage made = with_coupling({{2, 1, kOne}});
    made.section(
        format::Section::kJoints)[slides * format::joint::kLength + format::joint::kTypeAt] = 1;
    EXPECT_EQ(refusal_of(made.image()), Refusal::kBadReference) << slides;
  }
}

TEST(TableSensorTest, Reference_LiesBetweenMinus300And1000Degrees) {
  const auto with_reference = [](std::int32_t milli_degc) {
    TestImage made(3);
    made.header()[format::header::kSensorCountAt] = 1;
    Bytes sensor(format::sensor::kLength);
    put(sensor, format::sensor::kReferenceAt, milli_degc);
    made.add(format::Section::kSensors, sensor);
    return refusal_of(made.image());
  };
  EXPECT_EQ(with_reference(-300'000), Refusal::kValueRange);
  EXPECT_EQ(with_reference(-299'999), Refusal::kNone);
  EXPECT_EQ(with_reference(999'999), Refusal::kNone);
  EXPECT_EQ(with_reference(1'000'000), Refusal::kValueRange);
}

TEST(TableMassTest, TorqueWithoutAMassSet_ReportsItsSetField) {
  TestImage made(3);
  made.add_state(format::State::kTorque, 1, 27);
  const Bytes image = made.image();
  const Validation validation = validate(image, {});
  EXPECT_EQ(validation.refusal, Refusal::kBadReference);
  EXPECT_EQ(image[validation.field - format::state::kSetAt],
            static_cast<std::uint8_t>(format::State::kTorque));
}

TEST(TableMassTest, UnknownFlag_ReportsItsField) {
  TestImage made(3);
  Bytes set(record_length(format::Section::kMassSets, 3));
  set[format::mass_set::kFlagsAt] = 0x80;
  made.add(format::Section::kMassSets, set);
  made.add(format::Section::kGravity, Bytes(format::gravity::kLength));
  const Bytes image = made.image();
  const Validation validation = validate(image, {});
  EXPECT_EQ(validation.refusal, Refusal::kUnknownFlag);
  EXPECT_EQ(image[validation.field], 0x80);
}

TEST(TableMassTest, MassSets_DifferingInActsAtCommand_AreRefused) {
  const auto with_flags = [](std::uint8_t first, std::uint8_t second) {
    TestImage made(3);
    Bytes sets(2 * record_length(format::Section::kMassSets, 3));
    sets[format::mass_set::kFlagsAt] = first;
    sets[sets.size() / 2 + format::mass_set::kFlagsAt] = second;
    made.add(format::Section::kMassSets, sets);
    made.add(format::Section::kGravity, Bytes(format::gravity::kLength));
    return refusal_of(made.image());
  };
  constexpr std::uint8_t kAtCommand = format::mass_set::kActsAtCommand;
  EXPECT_EQ(with_flags(kAtCommand, kAtCommand), Refusal::kNone);
  EXPECT_EQ(with_flags(format::mass_set::kAllFlags, kAtCommand), Refusal::kNone);
  EXPECT_EQ(with_flags(kAtCommand, 0), Refusal::kValueRange);
  EXPECT_EQ(with_flags(0, kAtCommand), Refusal::kValueRange);
}

TEST(TableMassTest, Fraction_Above60_OrAbove30WithPayload_IsRefused) {
  const auto with_fraction = [](std::uint8_t fraction, std::uint8_t flags) {
    TestImage made(3);
    Bytes set(record_length(format::Section::kMassSets, 3));
    set[format::mass_set::kFractionAt] = fraction;
    set[format::mass_set::kFlagsAt] = flags;
    made.add(format::Section::kMassSets, set);
    made.add(format::Section::kGravity, Bytes(format::gravity::kLength));
    return refusal_of(made.image());
  };
  EXPECT_EQ(with_fraction(60, 0), Refusal::kNone);
  EXPECT_EQ(with_fraction(61, 0), Refusal::kValueRange);
  EXPECT_EQ(with_fraction(30, format::mass_set::kCarriesPayload), Refusal::kNone);
  EXPECT_EQ(with_fraction(31, format::mass_set::kCarriesPayload), Refusal::kValueRange);
}

TEST(TableWaveTest, WaveOfAMissingJoint_IsRefused) {
  const auto with_wave = [](std::uint8_t joint) {
    TestImage made(3);
    Bytes wave = {0, joint};
    wave.resize(format::slow_wave::kLength);
    made.add(format::Section::kSlowWaves, wave);
    return refusal_of(made.image());
  };
  EXPECT_EQ(with_wave(2), Refusal::kNone);
  EXPECT_EQ(with_wave(3), Refusal::kBadReference);
}

TEST(TableWaveTest, SixtyFourWaves_AreAccepted_OneMoreIsRefused) {
  TestImage made(3);
  for (std::size_t i = 0; i < kMaxSlowWaves; ++i) {
    made.add(format::Section::kSlowWaves, Bytes(format::slow_wave::kLength));
  }
  EXPECT_EQ(refusal_of(made.image()), Refusal::kNone);
  made.add(format::Section::kSlowWaves, Bytes(format::slow_wave::kLength));
  EXPECT_EQ(refusal_of(made.image()), Refusal::kTooManyRecords);
}

TEST(TableGridTest, TooManyNodes_AreRefusedBeforeMissingValues) {
  const auto with_nodes = [](std::uint16_t first, std::uint16_t second) {
    TestImage made(3);
    made.add_state(format::State::kMotor, 0, format::kPositionFraction);
    Bytes data = {2, 1, 0, 0};
    for (const std::uint16_t nodes : {first, second}) {
      append(data, std::uint16_t{1});  // the motor's position
      append(data, nodes);
      append(data, std::uint32_t{0});  // uniform
      append(data, std::int32_t{0});
      append(data, std::uint32_t{1} << 24);
    }
    made.add(format::Section::kData, data);
    Bytes node = {static_cast<std::uint8_t>(format::Node::kGrid), 0, 0, 1};
    node.resize(format::node::kLength);
    made.add(format::Section::kNodes, node);
    return refusal_of(made.image());
  };
  // 8192 nodes are permitted; this image is refused because it has no values for them.
  EXPECT_EQ(with_nodes(2, 4096), Refusal::kBadReference);
  EXPECT_EQ(with_nodes(2, 4097), Refusal::kTooManyRecords);
}

TEST(TableGridTest, StepOfZero_IsRefused_ReportsItsField) {
  TestImage made(3);
  made.add_table(0, -1.0, 0.5, {1e-4, 2e-4, 3e-4}, 24);
  constexpr std::size_t kInverseStepAt =
      16;  // after the grid's header, the axis's header and first node
  put(made.section(format::Section::kData), kInverseStepAt, std::uint32_t{0});
  const Bytes image = made.image();
  const Validation validation = validate(image, {});
  EXPECT_EQ(validation.refusal, Refusal::kValueRange);
  // The data section is the last one; its checksum of four bytes follows.
  const std::size_t data = made.section(format::Section::kData).size();
  EXPECT_EQ(validation.field, image.size() - 4 - data + kInverseStepAt);
}

TEST(TableCouplingTest, PositionsAtTheEndsOfTheirRange_DoNotOverflow) {
  // Under the sanitizers: the product of a position and a ratio may be any 64-bit number.
  TestImage made = with_coupling(
      {{2, 1, kMostNegative}, {1, 0, kMostNegative + 1}, {0, 2, -(kMostNegative + 1)}});
  made.add_constant(8 + 6, 1e-3);
  Bytes& joints = made.section(format::Section::kJoints);
  for (std::size_t k = 0; k < 3; ++k) {  // 2^4 increments a turn: positions of 2^59
    joints[k * format::joint::kLength + format::joint::kUnitShiftAt] = 2;
    joints[k * format::joint::kLength + format::joint::kIncrementShiftAt] = 58;
  }
  const Bytes image = made.image();
  Compensator compensator({.joint_count = 3});
  ASSERT_TRUE(compensator.load(image, {}).accepted());
  ASSERT_TRUE(compensator.activate());
  constexpr std::int32_t kEnds[] = {std::numeric_limits<std::int32_t>::min(),
                                    std::numeric_limits<std::int32_t>::max(), -1, 0x55555555};
  for (std::size_t i = 0; i < 256; ++i) {
    CycleInput input;
    for (std::size_t k = 0; k < 3; ++k) input.target[k] = kEnds[(i >> (2 * k)) % 4];
    const CycleOutput output = compensator.cycle(input);
    for (std::size_t k = 0; k < 3; ++k) EXPECT_LE(std::abs(output.delta[k]), 2);
  }
}

// The cost of a table. The tests add one kind of record at a time, to check the weight of each.
std::uint32_t cost_with(TestImage made) { return cycle_cost(made.image()); }

TEST(TableCostTest, ArmCost_DependsOnJointsAndFullPose) {
  EXPECT_EQ(cost_with(TestImage(3)), 4400U + 3 * 1595U + 15U);
  EXPECT_EQ(cost_with(TestImage(4)), 4400U + 4 * 1595U + 15U);
  TestImage pose(3);
  pose.header()[format::header::kFlagsAt] = format::kFlagFullPose;
  EXPECT_EQ(cost_with(pose), 9200U + 3 * 2060U + 15U);
}

TEST(TableCostTest, TermsAndHarmonics_CountOncePerEvaluation) {
  const std::uint32_t arm = cost_with(TestImage(3));
  TestImage terms(3);
  for (int i = 0; i < 6; ++i) terms.add_term(1, 0, 1e-3, 30);
  EXPECT_EQ(cost_with(terms), arm + 6 * 2 * 22U);
  Bytes image = terms.image();
  put(image, format::header::kConstantTermsAt, std::uint16_t{1});
  put(image, format::header::kSteepTermsAt, std::uint16_t{3});
  EXPECT_EQ(cycle_cost(image), arm + (1 + 2 * 3 + 3 * 2) * 22U);
  TestImage waves(3);
  for (int i = 0; i < 4; ++i) waves.add_harmonic(1, 1, 2.0, 0.0, 1e-4);
  image = waves.image();
  EXPECT_EQ(cycle_cost(image), arm + 4 * 2 * 62U);
  put(image, format::header::kSteepHarmonicsAt, std::uint16_t{3});
  EXPECT_EQ(cycle_cost(image), arm + (3 * 3 + 2) * 62U);
}

TEST(TableCostTest, FrameWithSeveralTerms_CountsOnce) {
  const std::uint32_t arm = cost_with(TestImage(3));
  TestImage made(3);
  made.add_constant(8 + 6, 1e-3);
  made.add_constant(8 + 6 + 5, 1e-3);
  EXPECT_EQ(cost_with(made), arm + 300U + 2 * 22U);
  made.add_constant(8, 1e-3);
  made.add_harmonic(8 + 6 * 9, 1, 1.0, 0.0, 1e-4);
  EXPECT_EQ(cost_with(made), arm + 3 * 300U + 3 * 22U + 2 * 62U);
}

TEST(TableCostTest, Line_CountsItsStateVariableNodeAndTerm) {
  const std::uint32_t arm = cost_with(TestImage(3));
  TestImage made(3);
  made.add_table(0, -1.0, 0.5, {1e-4, 2e-4, 3e-4}, 24);
  EXPECT_EQ(cost_with(made), arm + 3 * 44U + 2 * 115U + 2 * 22U);
}

TEST(TableCostTest, Coupling_CountsOncePerCycle) {
  EXPECT_EQ(cost_with(with_coupling({{2, 1, kOne}, {0, 1, kOne}})), cost_with(TestImage(3)) + 480U);
}

TEST(TableCostTest, Torques_CountTheirMassSetOnce_AndTheirCouplings) {
  constexpr std::uint32_t kFirst = 60U + 3 * 50U + 90U + 3 * 80U;  // gravity's vectors, the masses
  TestImage made(3);
  made.add_state(format::State::kTorque, 0, 27);
  EXPECT_EQ(cost_with(made), cost_with(TestImage(3)) + kFirst + 46U);
  made.add_state(format::State::kTorque, 2, 27);
  EXPECT_EQ(cost_with(made), cost_with(TestImage(3)) + kFirst + 2 * 46U);
  TestImage coupled = with_coupling({{2, 1, kOne}, {0, 1, kOne}});
  const std::uint32_t before = cost_with(coupled);
  coupled.add_state(format::State::kTorque, 1, 27);
  EXPECT_EQ(cost_with(coupled), before + kFirst + 46U + 2 * 44U + 2 * 9U);
}

TEST(TableCostTest, TorqueAtTheCommand_CountsTwice) {
  constexpr std::uint32_t kPass = 60U + 3 * 50U + 90U + 3 * 80U + 46U;
  TestImage made(3);
  Bytes set(record_length(format::Section::kMassSets, 3));
  set[format::mass_set::kFlagsAt] = format::mass_set::kActsAtCommand;
  made.add(format::Section::kMassSets, set);
  made.add_state(format::State::kTorque, 0, 27);
  EXPECT_EQ(cost_with(made), cost_with(TestImage(3)) + 2 * kPass);
}

TEST(TableCostTest, TableAtTheBudget_IsAccepted) {
  TestImage made(3);
  made.add_constant(1, 1e-3);
  made.add_constant(2, 1e-3);
  for (int i = 0; i < 191; ++i) made.add_harmonic(1, 1, 2.0, 0.0, 1e-4);
  for (int i = 0; i < 388; ++i) made.add_term(1, 0, 1e-3, 30);
  EXPECT_EQ(cost_with(made), kCycleBudget);
  EXPECT_EQ(refusal_of(made.image()), Refusal::kNone);
}

TEST(TableCostTest, TableAboveTheBudget_IsRefusedAsTooCostly) {
  TestImage made(3);
  for (int i = 0; i < 192; ++i) made.add_harmonic(1, 1, 2.0, 0.0, 1e-4);
  const std::uint32_t waves = cost_with(made);
  const auto room = static_cast<int>((kCycleBudget - waves) / 44U);
  for (int i = 0; i < room; ++i) made.add_term(1, 0, 1e-3, 30);
  EXPECT_EQ(refusal_of(made.image()), Refusal::kNone);
  EXPECT_GT(cost_with(made), kCycleBudget - 44U);
  made.add_term(1, 0, 1e-3, 30);
  EXPECT_EQ(refusal_of(made.image()), Refusal::kTooCostly);
  EXPECT_STREQ(name_of(Refusal::kTooCostly), "too much work for a control cycle");
}

// Joint 2 of three has no drive and is turned by joint 0.
TestImage with_passive_joint() {
  TestImage made(3);
  made.section(format::Section::kJoints)[2 * format::joint::kLength + format::joint::kFlagsAt] =
      format::joint::kPassive;
  Bytes coupling = {2, 0, 0, 0};
  append(coupling, -(std::int32_t{1} << format::coupling::kRatioFraction));
  made.add(format::Section::kCoupling, coupling);
  return made;
}

TEST(TablePassiveTest, PassiveJoint_DrivingOrWithSteepTerms_IsRefused) {
  EXPECT_EQ(refusal_of(with_passive_joint().image()), Refusal::kNone);
  TestImage drives = with_passive_joint();
  drives.section(format::Section::kCoupling)[format::coupling::kRowAt] = 1;
  drives.section(format::Section::kCoupling)[format::coupling::kColumnAt] = 2;
  EXPECT_EQ(refusal_of(drives.image()), Refusal::kBadReference);

  TestImage smooth = with_passive_joint();
  smooth.add_harmonic(2, format::node::kLinkAngle, 1.0, 0.0, 1e-3);
  EXPECT_EQ(refusal_of(smooth.image()), Refusal::kNone);
  put(smooth.header(), format::header::kSteepHarmonicsAt, std::uint16_t{1});
  EXPECT_EQ(refusal_of(smooth.image()), Refusal::kValueRange);
}

TEST(TablePassiveTest, PassiveJointOutput_EqualsItsTarget) {
  TestImage made = with_passive_joint();
  for (std::uint8_t k = 0; k < 3; ++k) made.add_constant(k, 2e-3);
  const Bytes image = made.image();
  Compensator compensator({.joint_count = 3, .cycle_us = 1000});
  ASSERT_TRUE(compensator.load(image, {}).accepted());
  ASSERT_TRUE(compensator.activate());
  EXPECT_EQ(compensator.passive(), 4);
  CycleInput input;
  input.target = {1'000'000, -2'000'000, 12'345};
  CycleOutput output;
  for (int cycle = 0; cycle < 2000; ++cycle) output = compensator.cycle(input);
  EXPECT_EQ(output.state, CompensatorState::kActive);
  EXPECT_NE(output.corrected[0], input.target[0]);
  EXPECT_EQ(output.corrected[2], input.target[2]);
  // The passive joint's target does not affect the correction.
  input.target[2] = -7'000'000;
  const CycleOutput other = compensator.cycle(input);
  EXPECT_EQ(other.delta, output.delta);
}

}  // namespace
}  // namespace armtrue
