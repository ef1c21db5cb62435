//! Windows of other programs over the simulator's window: a notification of the desktop, a pointer with its hint.
//!
//! They bypass the window manager (override-redirect), as desktops draw them.

use std::error::Error;
use std::fmt;

use x11rb::COPY_DEPTH_FROM_PARENT;
use x11rb::connection::Connection;
use x11rb::protocol::xproto::{
    ChangeGCAux, ConfigureWindowAux, ConnectionExt as _, CreateGCAux, CreateWindowAux,
    Rectangle as Area, StackMode, Window as WindowId, WindowClass,
};
use x11rb::rust_connection::RustConnection;
use x11rb::wrapper::ConnectionExt as _;

type Result<T> = std::result::Result<T, Box<dyn Error + Send + Sync>>;

/// 24-bit colour.
const DEPTH: u8 = 24;

/// A box that is filled with one colour: left, top, width, height in pixels, and red, green, blue.
type Fill = ([i32; 4], u32);

const PAPER: u32 = 0xf6_f5f4;
const HINT: u32 = 0xff_ffe1;
const INK: u32 = 0x30_3030;
const BLACK: u32 = 0;
const WHITE: u32 = 0xff_ffff;
/// Pointer height, pixels.
const POINTER_PX: i32 = 18;

/// A cover on a display, until it is dropped.
pub struct CoverWindow {
    connection: RustConnection,
    windows: Vec<WindowId>,
}

impl CoverWindow {
    /// A desktop's notification, opaque, with its corners cut; `area_px` is left, top, width, height on the display.
    ///
    /// # Errors
    /// There is no such display.
    pub fn notification(display: Option<&str>, area_px: [i32; 4]) -> Result<Self> {
        let [left, top, width, height] = area_px;
        let cut = 3.min(height / 4);
        let middle = [left, top + cut, width, height - 2 * cut];
        // Its upper and lower end are separate windows, so that the scene shows at the corners.
        let upper = [left + cut, top, width - 2 * cut, cut];
        let lower = [left + cut, top + height - cut, width - 2 * cut, cut];
        let parts = [(upper, vec![]), (middle, text(middle)), (lower, vec![])];
        Self::open(display, parts.map(|(area, ink)| (area, PAPER, ink)))
    }

    /// A pointer and the hint beside it; `area_px` encloses both.
    ///
    /// # Errors
    /// There is no such display.
    pub fn pointer_with_hint(display: Option<&str>, area_px: [i32; 4]) -> Result<Self> {
        let [left, top, width, height] = area_px;
        let pointer_px = POINTER_PX.min(height);
        let pointer = [left, top, pointer_px * 2 / 3, pointer_px];
        let shaft = vec![([1, 1, pointer_px / 3, pointer_px - 2], WHITE)];
        let hint = [left + pointer[2], top, width - pointer[2], height];
        let frame = vec![([1, 1, hint[2] - 2, hint[3] - 2], HINT)];
        let lines = frame.into_iter().chain(text(hint)).collect();
        Self::open(display, [(pointer, BLACK, shaft), (hint, BLACK, lines)])
    }

    fn open(
        display: Option<&str>,
        parts: impl IntoIterator<Item = ([i32; 4], u32, Vec<Fill>)>,
    ) -> Result<Self> {
        let (connection, screen) = RustConnection::connect(display)?;
        let screen = connection.setup().roots[screen].clone();
        let mut opened = Self {
            connection,
            windows: Vec::new(),
        };
        let connection = &opened.connection;
        for (area, ground, fills) in parts {
            let [left, top, width, height] = area;
            let (width, height) = (width.max(1) as u16, height.max(1) as u16);
            let window = connection.generate_id()?;
            let pixmap = connection.generate_id()?;
            let context = connection.generate_id()?;
            connection.create_pixmap(DEPTH, pixmap, screen.root, width, height)?;
            connection.create_gc(context, pixmap, &CreateGCAux::new().foreground(ground))?;
            let whole = [([0, 0, width.into(), height.into()], ground)];
            for ([x, y, width, height], colour) in whole.into_iter().chain(fills) {
                let area = Area {
                    x: x as i16,
                    y: y as i16,
                    width: width.max(0) as u16,
                    height: height.max(0) as u16,
                };
                let settings = ChangeGCAux::new().foreground(colour);
                connection.change_gc(context, &settings)?;
                connection.poly_fill_rectangle(pixmap, context, &[area])?;
            }
            let settings = CreateWindowAux::new()
                .override_redirect(1)
                .background_pixmap(pixmap);
            connection
                .create_window(
                    COPY_DEPTH_FROM_PARENT,
                    window,
                    screen.root,
                    left as i16,
                    top as i16,
                    width,
                    height,
                    0,
                    WindowClass::INPUT_OUTPUT,
                    screen.root_visual,
                    &settings,
                )?
                .check()?;
            connection.free_pixmap(pixmap)?;
            connection.free_gc(context)?;
            let above = ConfigureWindowAux::new().stack_mode(StackMode::ABOVE);
            connection.configure_window(window, &above)?;
            connection.map_window(window)?.check()?;
            opened.windows.push(window);
        }
        connection.sync()?;
        Ok(opened)
    }
}

impl Drop for CoverWindow {
    fn drop(&mut self) {
        // The X server closes them with the connection at the latest.
        for window in &self.windows {
            let _ = self.connection.destroy_window(*window);
        }
        let _ = self.connection.sync();
    }
}

impl fmt::Debug for CoverWindow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("CoverWindow")
            .field("windows", &self.windows)
            .finish_non_exhaustive()
    }
}

/// Lines of dashes inside a window of this area.
fn text([_, _, width, height]: [i32; 4]) -> Vec<Fill> {
    let lines = (5..height - 4).step_by(6);
    lines
        .flat_map(|y| (6..width - 8).step_by(5).map(move |x| ([x, y, 3, 1], INK)))
        .collect()
}
