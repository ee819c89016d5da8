// Tables that a device refuses, each with its own reason; no altered image is accepted.
#include "firmware/core/table/table.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "firmware/core/table/test_image.h"

namespace armtrue {
namespace {

using tests::append;
using tests::Bytes;
using tests::mend_checksum;
using tests::put;
using tests::TestImage;

constexpr std::array<std::uint8_t, 32> kSeed = {7, 1, 9};
constexpr std::array<std::uint8_t, 32> kOtherSeed = {8, 1, 9};

TestImage full_image() {
  TestImage made(3);
  const std::string serial = "ROBOT-7";
  std::copy(serial.begin(), serial.end(), made.header().begin() + format::header::kSerialAt);
  made.add_constant(0, 1e-3);
  made.add_constant(8 + 6 + 3, -2e-3);
  made.add_harmonic(1, 1, 1.0, 0.25, 1e-4);
  made.add_table(2, -1.0, 0.5, {1e-4, -1e-4, 2e-4, 0.0, 1e-4}, 24);
  return made;
}

DeviceIdentity any_device() { return {}; }

DeviceIdentity bound_to(const std::string& serial) {
  DeviceIdentity device;
  std::copy(serial.begin(), serial.end(), device.robot_serial.begin());
  return device;
}

DeviceIdentity with_key(const std::array<std::uint8_t, 32>& seed) {
  DeviceIdentity device;
  device.has_key = true;
  device.public_key = public_key_ed25519(seed);
  return device;
}

TEST(TableTest, TableForThisRobot_IsAccepted) {
  const Bytes image = full_image().image();
  EXPECT_EQ(validate(image, any_device()).refusal, Refusal::kNone);
  DeviceIdentity device = bound_to("ROBOT-7");
  device.joint_count = 3;
  EXPECT_TRUE(validate(image, device).accepted());
}

TEST(TableTest, RefusesAnotherRobotAndAnotherJointCount) {
  const Bytes image = full_image().image();
  EXPECT_EQ(validate(image, bound_to("ROBOT-8")).refusal, Refusal::kRobotSerial);
  EXPECT_EQ(validate(image, bound_to("ROBOT-70")).refusal, Refusal::kRobotSerial);
  EXPECT_EQ(validate(image, bound_to("R")).refusal, Refusal::kRobotSerial);
  DeviceIdentity six;
  six.joint_count = 6;
  const Validation validation = validate(image, six);
  EXPECT_EQ(validation.refusal, Refusal::kJointCount);
  EXPECT_EQ(validation.field, format::header::kJointCountAt);
}

TEST(TableTest, BaseRecord_OnceIsAccepted_TwiceIsRefused) {
  TestImage made(3);
  made.section(format::Section::kBase).resize(format::base::kLength);
  EXPECT_EQ(validate(made.image(), any_device()).refusal, Refusal::kNone);
  made.section(format::Section::kBase).resize(2 * format::base::kLength);
  EXPECT_EQ(validate(made.image(), any_device()).refusal, Refusal::kTooManyRecords);
}

TEST(TableTest, SteepHarmonic_OnALink_IsRefused) {
  TestImage made(3);
  made.add_harmonic(0, 1, 1.0, 0.25, 1e-4);
  made.add_harmonic(format::kMotorCoordinates + 6, 1, 1.0, 0.25, 1e-4);
  put(made.header(), format::header::kSteepHarmonicsAt, std::uint16_t{1});
  EXPECT_EQ(validate(made.image(), any_device()).refusal, Refusal::kNone);
  put(made.header(), format::header::kSteepHarmonicsAt, std::uint16_t{2});
  EXPECT_EQ(validate(made.image(), any_device()).refusal, Refusal::kValueRange);
}

TEST(TableTest, DuplicateSection_IsRefusedAtItsSecondEntry) {
  TestImage made(3);
  made.add(format::Section::kNodes, Bytes(format::node::kLength));
  made.add_harmonic(1, 1, 1.0, 0.25, 1e-4);
  Bytes image = made.image();
  const std::size_t entry = format::header::kLength + 4 * format::kDirectoryEntryLength;
  // In the place of kHarmonics.
  put(image, entry, static_cast<std::uint16_t>(format::Section::kNodes));
  mend_checksum(image);
  const Validation validation = validate(image, any_device());
  EXPECT_EQ(validation.refusal, Refusal::kSectionBounds);
  EXPECT_EQ(validation.field, entry);
}

TEST(TableTest, TableWithoutJointsToolsOrState_IsRefused) {
  for (const format::Section kind :
       {format::Section::kJoints, format::Section::kTools, format::Section::kState}) {
    TestImage made(3);
    made.remove(kind);
    EXPECT_EQ(validate(made.image(), any_device()).refusal, Refusal::kMissingSection)
        << static_cast<int>(kind);
  }
}

TEST(TableTest, RefusesANewerFormatByItsOwnReason) {
  Bytes image = full_image().image();
  put(image, format::header::kVersionAt, std::uint16_t{2});
  EXPECT_EQ(validate(image, any_device()).refusal, Refusal::kNewerFormat);
  mend_checksum(image);
  const Validation validation = validate(image, any_device());
  EXPECT_EQ(validation.refusal, Refusal::kNewerFormat);
  EXPECT_EQ(validation.field, format::header::kVersionAt);
}

TEST(TableTest, SignaturesBindTheImageToTheKey) {
  const Bytes plain = full_image().image();
  const Bytes made = full_image().image(&kSeed);
  EXPECT_TRUE(validate(made, with_key(kSeed)).accepted());
  EXPECT_TRUE(validate(made, any_device()).accepted());
  EXPECT_EQ(validate(plain, with_key(kSeed)).refusal, Refusal::kUnsigned);
  EXPECT_EQ(validate(made, with_key(kOtherSeed)).refusal, Refusal::kSignature);
  Bytes forged = made;  // a limit raised, and the checksum corrected
  put(forged, format::header::kLength + 5 * 8 + format::joint::kMagnitudeAt, std::int32_t{1} << 30);
  mend_checksum(forged);
  EXPECT_EQ(validate(forged, with_key(kSeed)).refusal, Refusal::kSignature);
}

TEST(TableTest, EverySingleByteCorruptionIsRefused) {
  for (const std::array<std::uint8_t, 32>* seed :
       {static_cast<const std::array<std::uint8_t, 32>*>(nullptr), &kSeed}) {
    const Bytes image = full_image().image(seed);
    for (std::size_t i = 0; i < image.size(); ++i) {
      for (const unsigned flip : {0x01U, 0x80U, 0xFFU}) {
        Bytes bad = image;
        bad[i] = static_cast<std::uint8_t>(bad[i] ^ flip);
        EXPECT_FALSE(validate(bad, any_device()).accepted()) << "byte " << i;
      }
    }
  }
}

TEST(TableTest, EveryTruncationAndExtensionIsRefused) {
  const Bytes image = full_image().image(&kSeed);
  for (std::size_t length = 0; length < image.size(); ++length) {
    EXPECT_FALSE(validate(std::span(image).first(length), any_device()).accepted()) << length;
  }
  Bytes longer = image;
  longer.push_back(0);
  EXPECT_EQ(validate(longer, any_device()).refusal, Refusal::kLength);
}

// A field changed in a valid image with corrected checksum; the expected refusal and its field.
struct BadField {
  const char* name;
  std::size_t at;
  std::uint8_t value;
  Refusal refusal;
  int begin = 0;  // start of the reported field, relative to `at`
};

class BadFieldTest : public ::testing::TestWithParam<BadField> {};

TEST_P(BadFieldTest, IsRefused_WithReasonAndField) {
  Bytes image = full_image().image();
  const std::uint8_t before = image[GetParam().at];
  ASSERT_NE(before, GetParam().value);
  image[GetParam().at] = GetParam().value;
  mend_checksum(image);
  const Validation validation = validate(image, any_device());
  EXPECT_EQ(validation.refusal, GetParam().refusal) << name_of(validation.refusal);
  EXPECT_EQ(static_cast<int>(validation.field) - static_cast<int>(GetParam().at), GetParam().begin);
}

namespace header = format::header;
constexpr std::size_t kFirstJoint = header::kLength + 7 * format::kDirectoryEntryLength;
constexpr std::size_t kTool = kFirstJoint + 3 * format::joint::kLength;
constexpr std::size_t kStates = kTool + format::tool::kLength;
constexpr std::size_t kNode = kStates + 2 * format::state::kLength;
constexpr std::size_t kTerms = kNode + format::node::kLength;
constexpr std::size_t kHarmonic = kTerms + 3 * format::term::kLength;
constexpr std::size_t kData = kHarmonic + format::harmonic::kLength;

INSTANTIATE_TEST_SUITE_P(
    Fields, BadFieldTest,
    ::testing::Values(
        BadField{"unknown flag", header::kFlagsAt, 0x80, Refusal::kUnknownFlag},
        BadField{"no joints", header::kJointCountAt, 0, Refusal::kValueRange},
        BadField{"too many joints", header::kJointCountAt, 9, Refusal::kValueRange},
        BadField{"tool that is not there", header::kActiveToolAt, 1, Refusal::kBadReference},
        BadField{"reserved byte", header::kReservedAt, 1, Refusal::kReserved},
        BadField{"serial that begins with a control character", header::kSerialAt, 7,
                 Refusal::kValueRange},
        BadField{"serial with a control character", header::kSerialAt + 2, 7, Refusal::kValueRange},
        BadField{"serial that goes on after its end", header::kSerialAt + 12, 'x',
                 Refusal::kValueRange},
        BadField{"no damping", header::kDampingAt + 2, 0, Refusal::kValueRange, -2},
        BadField{"rotation length without full pose", header::kRotationLengthAt + 3, 1,
                 Refusal::kValueRange, -3},
        BadField{"more constant terms than terms", header::kConstantTermsAt, 200,
                 Refusal::kValueRange},
        BadField{"more steep nodes than nodes", header::kSteepNodesAt, 9, Refusal::kValueRange},
        BadField{"unknown section", header::kLength, 99, Refusal::kUnknownSection},
        BadField{"section that starts elsewhere", header::kLength + 4, 0, Refusal::kSectionBounds},
        BadField{"section that is too long", header::kLength + 2, 200, Refusal::kSectionBounds},
        BadField{"unknown joint type", kFirstJoint + format::joint::kTypeAt, 2,
                 Refusal::kUnknownKind},
        BadField{"joint shift", kFirstJoint + format::joint::kUnitShiftAt, 63,
                 Refusal::kValueRange},
        BadField{"unknown flag of a joint", kFirstJoint + format::joint::kFlagsAt, 2,
                 Refusal::kReserved},
        BadField{"negative limit", kFirstJoint + format::joint::kMagnitudeAt + 3, 0x80,
                 Refusal::kValueRange, -3},
        BadField{"rotation that stretches", kFirstJoint + 3, 0x20, Refusal::kValueRange, -3},
        BadField{"arm beyond the range", kFirstJoint + 36 + 3, 0x70, Refusal::kValueRange, -3},
        BadField{"unknown state variable", kStates + 4, 12, Refusal::kUnknownKind},
        BadField{"state variable of a joint that is not there", kStates + 5, 3,
                 Refusal::kBadReference},
        BadField{"state variable with another fraction", kStates + 7, 27, Refusal::kValueRange},
        BadField{"unknown node", kNode, 16, Refusal::kUnknownKind},
        BadField{"node that reads beyond the data", kNode + 12, 200, Refusal::kBadReference},
        BadField{"unused field of a node", kNode + 1, 1, Refusal::kReserved},
        BadField{"grid with another number of outputs", kNode + 3, 2, Refusal::kValueRange},
        BadField{"coordinate of a link that is not there", kTerms, 8 + 6 * 4,
                 Refusal::kUnknownKind},
        BadField{"term that reads no slot", kTerms + 2 * 8 + 2, 50, Refusal::kBadReference},
        BadField{"constant term that moves", kTerms + 2, 1, Refusal::kBadReference},
        BadField{"harmonic of a joint that is not there", kHarmonic + 2, 3, Refusal::kBadReference},
        BadField{"grid with too many axes", kData, 5, Refusal::kValueRange},
        BadField{"axis of one node", kData + 6, 1, Refusal::kValueRange},
        BadField{"unknown axis flag", kData + 8, 8, Refusal::kUnknownFlag},
        BadField{"axis that reads itself", kData + 4, 2, Refusal::kBadReference},
        BadField{"uncovered node that is not zero", kData + 20, 0xFE, Refusal::kValueRange, 4}),
    [](const ::testing::TestParamInfo<BadField>& field) {
      std::string name = field.param.name;
      std::replace(name.begin(), name.end(), ' ', '_');
      return name;
    });

TEST(TableTest, EveryReasonHasItsOwnName) {
  std::vector<std::string> names;
  for (std::uint8_t i = 0; i <= static_cast<std::uint8_t>(Refusal::kResolution); ++i) {
    names.emplace_back(name_of(static_cast<Refusal>(i)));
  }
  std::sort(names.begin(), names.end());
  EXPECT_EQ(std::adjacent_find(names.begin(), names.end()), names.end());
}

}  // namespace
}  // namespace armtrue
