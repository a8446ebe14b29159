#include "idol/base/options.hpp"

#include "idol/base/diagnostics.hpp"
#include "idol/odometry/odometry.hpp"
#include "test_util.hpp"

namespace idol {
namespace {

std::vector<OptionField> fields_of(Options& options) {
  std::vector<OptionField> fields;
  list_fields(options, fields);
  return fields;
}

TEST(Options, DumpAndLoadAreInverse) {
  const test::TempDir dir;
  Options a, b;
  a.window.max_events = 1234;
  a.segment.same_polarity = !a.segment.same_polarity;
  a.backend.cull_px = 0.1 + 0.2;
  load_options(fields_of(b), dir.write("c.yaml", dump_options(fields_of(a))));
  EXPECT_EQ(dump_options(fields_of(a)), dump_options(fields_of(b)));
  EXPECT_EQ(b.backend.cull_px, a.backend.cull_px);
}

TEST(Options, UnknownKeysAndBadValuesNameFileAndLine) {
  const test::TempDir dir;
  Options options;
  const auto message = [&](const std::string& text) -> std::string {
    try {
      load_options(fields_of(options), dir.write("c.yaml", text));
    } catch (const UsageError& e) {
      return e.what();
    }
    return "accepted";
  };
  EXPECT_NE(message("window:\n  max_event: 5\n").find("c.yaml:2"), std::string::npos);
  EXPECT_NE(message("window:\n  max_event: 5\n").find("window.max_event"), std::string::npos);
  EXPECT_NE(message("window:\n  max_events: many\n").find("whole number"), std::string::npos);
  EXPECT_NE(message("segment:\n  radius_px: 1e9\n").find("outside"), std::string::npos);
  EXPECT_NE(message("a: [1\n").find("c.yaml:"), std::string::npos);
  EXPECT_EQ(message("window:\n  max_events: 5000\n"), "accepted");
  EXPECT_EQ(options.window.max_events, 5000);
  EXPECT_THROW(load_options(fields_of(options), dir.path() / "absent.yaml"), DataError);
  EXPECT_THROW(set_option(fields_of(options), "window.max_events", "1e3", "--set"), UsageError);
}

TEST(Options, EveryFieldHasAMeaning) {
  Options options;
  for (const auto& field : fields_of(options)) EXPECT_GT(field.doc.size(), 5U) << field.name;
}

}  // namespace
}  // namespace idol
