#include "idol/io/number.hpp"

#include <array>
#include <random>

#include "idol/io/trajectory_io.hpp"
#include "test_util.hpp"

namespace idol {
namespace {

TEST(Number, StampsAreExact) {
  EXPECT_EQ(parse_stamp("2.097134001"), 2'097'134'001);
  EXPECT_EQ(parse_stamp("2.09714"), 2'097'140'000);
  EXPECT_EQ(parse_stamp("1468939993.067416019"), 1'468'939'993'067'416'019);
  EXPECT_EQ(parse_stamp("5"), 5'000'000'000);
  EXPECT_EQ(parse_stamp("5."), 5'000'000'000);
  EXPECT_EQ(parse_stamp(".5"), 500'000'000);
  EXPECT_EQ(parse_stamp("+1.5"), 1'500'000'000);
  EXPECT_EQ(parse_stamp("-1.5"), -1'500'000'000);
  EXPECT_EQ(parse_stamp("-0.000000001"), -1);
  EXPECT_EQ(parse_stamp("0"), 0);
  EXPECT_EQ(parse_stamp("0.000e5"), 0);
}

TEST(Number, MoreThanNineDecimalsAreRounded) {
  EXPECT_EQ(parse_stamp("0.0000000004"), 0);
  EXPECT_EQ(parse_stamp("0.0000000005"), 1);
  EXPECT_EQ(parse_stamp("0.99999999999999999999"), 1'000'000'000);
  EXPECT_EQ(parse_stamp("0.000051999999999999995"), 52'000);
}

TEST(Number, ScientificStampsAreExact) {
  EXPECT_EQ(parse_stamp("1.468939993067416019e+09"), 1'468'939'993'067'416'019);
  EXPECT_EQ(parse_stamp("2.097134001000000000e+00"), 2'097'134'001);
  EXPECT_EQ(parse_stamp("5.2E-05"), 52'000);
  EXPECT_EQ(parse_stamp("0.00052e-1"), 52'000);
  EXPECT_EQ(parse_stamp("4e-10"), 0);
  EXPECT_EQ(parse_stamp("6e-10"), 1);
  EXPECT_EQ(parse_stamp("1e-99999"), 0);
  EXPECT_EQ(parse_stamp("-1e1"), -10'000'000'000);
}

TEST(Number, WhatIsNoStampIsRefused) {
  for (const char* token :
       {"", "-", ".", "e5", "1.2.3", "1e", "abc", "nan", "inf", "1x", "0x10", "1468939993067416019", "1e10",
        "1e99999999999", "4600000001", "--1", "+-1", "1,5"}) {
    EXPECT_FALSE(parse_stamp(token)) << token;
  }
}

TEST(Number, StampsComeBackFromText) {
  std::mt19937_64 rng(1);
  std::uniform_int_distribution<Time> any(-kLargestStamp, kLargestStamp);
  for (int i = 0; i < 2000; ++i) {
    const Time t = any(rng);
    EXPECT_EQ(parse_stamp(format_stamp(t)), t);
  }
  EXPECT_EQ(format_stamp(-1), "-0.000000001");
  EXPECT_EQ(format_stamp(0), "0.000000000");
}

TEST(Number, DoublesAndIntegers) {
  EXPECT_EQ(parse_double("1e-3"), 1e-3);
  EXPECT_EQ(parse_double("+2.5"), 2.5);
  EXPECT_TRUE(std::isnan(*parse_double("nan")));
  EXPECT_TRUE(std::isnan(*parse_double("-nan")));
  EXPECT_TRUE(std::isinf(*parse_double("1e999")));
  EXPECT_EQ(parse_double("1e-999"), 0.0);
  EXPECT_FALSE(parse_double("1,5"));
  EXPECT_FALSE(parse_double(""));
  EXPECT_EQ(parse_integer("-12"), -12);
  EXPECT_FALSE(parse_integer("1.0"));
  EXPECT_FALSE(parse_integer("99999999999999999999"));
}

TEST(Number, ColumnsAreParted) {
  std::array<std::string_view, 3> columns;
  EXPECT_EQ(split_columns(" 1\t2 , 3  ", columns), 3u);
  EXPECT_EQ(columns[2], "3");
  EXPECT_EQ(split_columns("1 2 3 4 5", columns), 5u);
  EXPECT_EQ(split_columns("", columns), 0u);
  EXPECT_TRUE(is_blank_or_comment("  # t x y p"));
  EXPECT_TRUE(is_blank_or_comment(" \t"));
  EXPECT_FALSE(is_blank_or_comment("1 # 2"));
}

}  // namespace
}  // namespace idol
