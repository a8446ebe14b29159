#include "idol/report/report.hpp"

#include <string>
#include <string_view>

#include "idol/io/text_writer.hpp"
#include "idol/report/page_data.hpp"
#include "idol/report/run_folder.hpp"

namespace idol {

/// The page with style and scripts in place; made from src/idol/report/page at build time.
std::string_view report_page();

void write_report(const std::filesystem::path& run_dir) {
  constexpr std::string_view kMark = "@IDOL_RUN_DATA@";
  const std::string data = page_data(read_run_folder(run_dir));
  const std::string_view empty_page = report_page();
  const std::size_t mark = empty_page.find(kMark);
  std::string page(empty_page.substr(0, mark));
  page += data;
  page += empty_page.substr(mark + kMark.size());
  write_text_file(run_dir / "report.html", page);
}

}  // namespace idol
